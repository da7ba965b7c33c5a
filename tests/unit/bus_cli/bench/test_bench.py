"""`bus bench`: its command line, payloads and figures; and sessions whose workers do not start."""

import os
import socket
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.qos import QoSProfile
from bus.types.support import type_support
from bus_cli.bench import session
from bus_cli.bench.figures import Run, ages, bytes_text, percentile, plots, tables
from bus_cli.bench.measure import judge
from bus_cli.bench.options import add_bench_arguments, read_plan, read_sizes
from bus_cli.bench.payload import BYTES, HEAD, Payload, Stamps, read_stamps
from bus_cli.bench.progress import Bar
from bus_cli.bench.session import Session, worker_environ
from bus_cli.bench.task import Go, Sent, Settled, Task
from bus_cli.output import CommandError
from rows import for_each

STRING = "std_msgs/msg/String"
LOSSLESS = QoSProfile(history="keep_all")
DOCS = Path(__file__).parents[4] / "docs" / "cli.md"


def parse(*words: str, rate: float = 0.0) -> Namespace:
    parser = ArgumentParser(exit_on_error=False)
    add_bench_arguments(parser, subscribers=1, rate=rate)
    return parser.parse_args(words)


def sent(count: int, begin_ms: int = 0, end_ms: int = 1000) -> Sent:
    return Sent(count=count, begin_ns=begin_ms * 10**6, end_ns=end_ms * 10**6)


def settled(delivered: int, *ages_us: int, late_us: int = 0, **dropped: int) -> Settled:
    """The result of a subscriber. Its messages were sent 1 ms apart, and the last one arrived after two
    seconds.
    """
    return Settled(
        delivered=delivered,
        dropped=dropped,
        last_ns=2 * 10**9,
        sent_ns=[number * 10**6 for number in range(len(ages_us))],
        late_ns=[late_us * 1000] * len(ages_us),
        age_ns=[age * 1000 for age in ages_us],
    )


# --- the command line


@for_each(
    ("text", "sizes"),
    [
        ("64", (64,)),
        ("64B", (64,)),
        ("1K,1KiB,1KB", (1024, 1024, 1000)),
        ("4MiB, 2m", (4 << 20, 2 << 20)),
        ("32", (HEAD,)),
        ("1GiB", (1 << 30,)),
    ],
)
def test_sizes(text: str, sizes: tuple[int, ...]) -> None:
    assert read_sizes(text) == sizes


@for_each(
    ("text", "complaint"),
    [
        ("0", "0 is too small: the stamps need 32 B"),
        ("31", "31 is too small"),
        ("64,", "'' is not a size"),
        ("-1", "'-1' is not a size"),
        ("1.5K", "'1.5K' is not a size"),
        ("1X", "'1X' is not a size"),
        ("2GiB", "2GiB is too large: no message may have more than 1073741824 B"),
    ],
)
def test_what_is_no_size(text: str, complaint: str) -> None:
    with pytest.raises(ArgumentTypeError, match=complaint):
        read_sizes(text)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--rate", "0"),
        ("--rate", "-1"),
        ("--rate", "nan"),
        ("--count", "0"),
        ("--count", "1.5"),
        ("--seconds", "0"),
        ("--seconds", "inf"),
        ("--warm-up", "-1"),
        ("--publishers", "0"),
        ("--subscribers", "129"),
    ],
)
def test_mistakes_name_option_value_and_limits(
    option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises((Exception, SystemExit)) as caught:  # which of them depends on the version of Python
        parse(option, value)
    text = f"{caught.value} {capsys.readouterr().err}"
    assert f"argument {option}: '{value}' is not" in text
    assert "from " in text


def test_without_qos_options_nothing_is_lost() -> None:
    assert read_plan(parse(), "latency", (1.0,)).qos == LOSSLESS


@for_each(
    ("words", "qos"),
    [
        (("--qos-depth", "5"), QoSProfile(5)),
        (("--qos-reliability", "reliable"), QoSProfile()),
        (("--qos-reliability", "best_effort"), QoSProfile(reliability="best_effort")),
        (("--qos-profile", "sensor_data"), QoSProfile(5, reliability="best_effort")),
        (("--qos-history", "keep_all"), LOSSLESS),
    ],
)
def test_qos_options_change_the_default_profile(words: tuple[str, ...], qos: QoSProfile) -> None:
    assert read_plan(parse(*words), "latency", (1.0,)).qos == qos


def test_how_long_a_plan_publishes() -> None:
    plan = read_plan(parse("--seconds", "2", "--warm-up", "0.5"), "fanout", (0.0, 100.0))
    assert plan.measured(0.0) == Go(count=0, seconds=2.0)
    assert plan.measured(100.0).count == 200
    assert (plan.warm_up(0.0), plan.warm_up(100.0)) == (Go(count=0, seconds=0.5), Go(count=50, seconds=0.5))
    plan = read_plan(parse("--count", "7", "--warm-up", "0"), "fanout", (0.0, 100.0))
    assert (plan.measured(0.0).count, plan.measured(100.0).count) == (7, 7)
    assert plan.warm_up(100.0) is None


# --- payloads


@for_each(
    ("name", "size", "field"),
    [
        (STRING, 64, "data"),
        ("std_msgs/String", HEAD, "data"),
        (BYTES, 1000, "data"),
        ("std_msgs/msg/ByteMultiArray", 64, "data"),
        ("sensor_msgs/msg/Image", 4096, "data"),
        ("sensor_msgs/msg/LaserScan", 4 * HEAD, "ranges"),
        ("std_msgs/msg/Int8MultiArray", HEAD, "data"),
        ("std_msgs/msg/Float64MultiArray", 1024, "data"),
    ],
)
def test_messages_arrive_with_their_size_and_stamps(name: str, size: int, field: str) -> None:
    payload = Payload(name, size)
    support: Any = type_support(payload.type)
    plain, stamped = (
        support.decode(support.encode_checked(one)) for one in (payload.plain(), payload.stamped(5, 7))
    )
    assert payload.field == field
    for message, is_marked in ((plain, False), (stamped, True)):
        width = size // len(payload.get(message))
        assert len(payload.get(message)) * width == size
        assert (payload.get(message)[0] == payload.mark) is is_marked
    assert read_stamps(payload.get(stamped)[:HEAD]) == Stamps(5, 7)
    assert payload.plain() is not payload.plain()


def test_stamps_have_room_for_centuries() -> None:
    late = 2**60 - 1
    payload = Payload(STRING, HEAD)
    assert read_stamps(payload.get(payload.stamped(late, late))) == Stamps(late, late)


@for_each(
    ("name", "size", "complaint"),
    [
        ("no/msg/Such", 64, "--type no/msg/Such: there is no such message type"),
        ("String", 64, "The passed message type is invalid"),
        ("geometry_msgs/msg/Twist", 64, "--type geometry_msgs/msg/Twist: it has no field of bytes, text or"),
        ("sensor_msgs/msg/LaserScan", 64, "--size 64: the smallest for sensor_msgs/msg/LaserScan is 128 B"),
        (
            "sensor_msgs/msg/LaserScan",
            130,
            "--size 130: sensor_msgs/msg/LaserScan.ranges has elements of 4 B",
        ),
    ],
)
def test_types_and_sizes_that_cannot_be(name: str, size: int, complaint: str) -> None:
    with pytest.raises(CommandError) as caught:
        Payload(name, size)
    assert str(caught.value).startswith(complaint)


# --- figures


@for_each(("percent", "value"), [(0, 1), (0.1, 1), (0.11, 2), (50, 500), (99, 990), (99.9, 999), (100, 1000)])
def test_percentiles_are_by_nearest_rank(percent: float, value: int) -> None:
    assert percentile(range(1, 1001), percent) == value


@given(
    st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=300),
    st.one_of(st.sampled_from([50, 90, 99, 99.9, 100]), st.integers(0, 100)),
)
def test_percentile_is_the_smallest_that_enough_do_not_exceed(samples: list[float], percent: float) -> None:
    ordered = sorted(samples)

    found = percentile(ordered, percent)

    def exceeds_no_more_than(value: float) -> float:
        return 100 * sum(one <= value for one in ordered) / len(ordered)

    assert found in ordered
    assert exceeds_no_more_than(found) >= percent - 1e-9
    smaller = [one for one in ordered if one < found]
    assert not smaller or exceeds_no_more_than(smaller[-1]) < percent


def test_what_has_no_percentile() -> None:
    for ordered, percent in (((), 50), ((1,), 101), ((1,), -1)):
        with pytest.raises(ValueError, match="percentile"):
            percentile(ordered, percent)
    assert ages(()) is None


def test_ages_are_in_microseconds() -> None:
    found = ages([3000, 1000, 2000])
    assert msgspec.to_builtins(found) == {
        "samples": 3, "p50": 2.0, "p90": 3.0, "p99": 3.0, "p99.9": 3.0, "max": 3.0,
        "histogram": [(0.0, 1.024, 1), (1.536, 2.048, 1), (2.048, 3.072, 1)],
    }  # fmt: skip


def test_a_run_accounts_for_every_delivery() -> None:
    run = Run.of(64, 0.0, "shm", [sent(60), sent(40)], [settled(90, replaced=10), settled(80, expired=5)])
    assert (run.published, run.expected, run.delivered) == (100, 200, 170)
    assert run.dropped == {"replaced": 10, "expired": 5}
    assert run.unaccounted == 15
    assert not run.is_complete
    assert "30 of 200 (expired: 5, replaced: 10, unaccounted: 15)" in tables([run])


def test_rates_are_from_the_first_publication_to_the_last_arrival() -> None:
    run = Run.of(64, 10.0, "shm", [sent(50, begin_ms=500), sent(50, begin_ms=0)], [settled(100)])
    assert (run.seconds, run.published_per_s) == (2.0, 100.0)
    assert (run.delivered_per_s, run.bytes_per_s) == (50.0, 3200.0)
    assert run.is_complete


def test_what_was_late_counts_in_the_age_since_due() -> None:
    run = Run.of(64, 10.0, "shm", [sent(2)], [settled(2, 100, 200, late_us=1000)])
    assert run.since_sent_us is not None and run.since_sent_us.max == 200
    assert run.since_due_us is not None and run.since_due_us.p50 == 1100
    flood = Run.of(64, 0.0, "shm", [sent(2)], [settled(2, 100, 200)])
    assert (flood.rate, flood.since_due_us, flood.last_us) == (None, None, None)


def test_the_age_at_the_last_subscriber() -> None:
    """The figure covers messages that all subscribers have: the second subscriber lost the third message."""
    run = Run.of(64, 10.0, "shm", [sent(3)], [settled(3, 100, 250, 900), settled(2, 300, 200, replaced=1)])
    assert run.last_us is not None
    assert (run.last_us.samples, run.last_us.p50, run.last_us.max) == (2, 250, 300)
    assert "sent, to the last" in tables([run])


def test_a_histogram_of_the_ages() -> None:
    """Parts between the first and the last one stand there, too, without a bar."""
    run = Run.of(64, 10.0, "shm", [sent(5)], [settled(5, 100, 100, 101, 100, 400)])
    assert run.since_sent_us is not None
    first, last = run.since_sent_us.histogram[0], run.since_sent_us.histogram[-1]
    assert first[0] <= 100 < first[1] and last[0] <= 400 < last[1]
    assert (first[2], last[2]) == (4, 1)
    text = plots([run], 8)
    assert text[:2] == ["", "64 B, 10/s, since sent:"]
    assert [line.split(" ... ")[1].split(" ", 2)[2] for line in text[2:7]] == [
        *(f"{'▇' * 8} 4", f"{'':8} 0", f"{'':8} 0", f"{'':8} 0"),
        f"{'▇▇':8} 1",
    ]
    assert text[7:9] == ["", "64 B, 10/s, since due:"]


def test_nothing_at_all_arrived() -> None:
    run = Run.of(64, 10.0, "shm", [sent(2)], [Settled(0, {"replaced": 2}, 0, [], [], [])])
    assert (run.since_sent_us, run.since_due_us, run.delivered_per_s) == (None, None, 0.0)
    assert "2 of 2 (replaced: 2)" in tables([run])
    assert plots([run], 8) == []


def test_a_loss_is_an_error_only_where_none_was_promised(capsys: pytest.CaptureFixture[str]) -> None:
    whole = Run.of(64, 0.0, "shm", [sent(2)], [settled(2)])
    lossy = Run.of(64, 0.0, "shm", [sent(2)], [settled(1, replaced=1)])
    assert judge(LOSSLESS, [whole]) == judge(QoSProfile(), [whole, lossy]) == 0
    assert capsys.readouterr().err == ""
    assert judge(LOSSLESS, [whole, lossy]) == 1
    assert "messages were lost" in capsys.readouterr().err


@for_each(
    ("size", "text"),
    [(64, "64 B"), (1024, "1 KiB"), (1500, "1500 B"), (1 << 20, "1 MiB"), (3 << 10, "3 KiB")],
)
def test_sizes_as_text(size: int, text: str) -> None:
    assert bytes_text(size) == text


def test_the_documentation_has_every_key() -> None:
    text = DOCS.read_text()
    assert [name for name in Run.__struct_fields__ if f"`{name}`" not in text] == []


# --- sessions


def task(path: Path) -> Task:
    return Task(
        role="",
        socket=str(path),
        topic="/_bench/test",
        type_name=STRING,
        size=64,
        rate=0.0,
        publishers=1,
        subscribers=1,
        qos=LOSSLESS,
    )


def is_alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def fail_to_start(path: Path) -> str:
    """Returns the error of a session that fails to start. Its processes must have ended."""
    running = Session(task(path), worker_environ(None), lambda count: None)
    with pytest.raises(CommandError) as caught, running:
        running.start()
    pids = [worker.pid for worker in running.workers]
    assert len(pids) == 2
    assert not any(map(is_alive, pids))
    return str(caught.value)


def test_workers_that_hang_are_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus accepts their connections, and sends nothing."""
    monkeypatch.setattr(session, "SILENT_S", 0.2)
    monkeypatch.setattr(session, "START_S", 0.0)
    path = tmp_path / "mute.sock"
    with socket.socket(socket.AF_UNIX) as mute:
        mute.bind(str(path))
        mute.listen()
        text = fail_to_start(path)
    assert text.startswith("gave up: no progress for 0.2 s by subscriber 1 (pid ")
    assert "publisher 1 (pid " in text


def test_what_a_worker_cannot_do_is_told(tmp_path: Path) -> None:
    assert "no busd listens on" in fail_to_start(tmp_path / "none.sock")


def test_a_worker_that_dies_is_told_with_its_last_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "_MODULE", "bus_cli.bench.no_such_worker")
    text = fail_to_start(tmp_path / "none.sock")
    assert " exited with 1: " in text
    assert "No module named bus_cli.bench.no_such_worker" in text


def test_without_rich_there_is_no_bar(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setitem(sys.modules, "rich.console", None)
    with Bar() as bar:
        bar.begin("64 B")
        bar.show("measures", 0.5)
    assert capsys.readouterr() == ("", "")


def test_the_route_is_asked_for_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_ROUTE", "socket")
    assert worker_environ(None)["BUS_ROUTE"] == "socket"
    assert "BUS_ROUTE" not in worker_environ("shm")
    monkeypatch.delenv("BUS_ROUTE")
    assert worker_environ("socket")["BUS_ROUTE"] == "socket"
    assert "BUS_ROUTE" not in worker_environ(None)
    assert "BUS_ROUTE" not in os.environ
