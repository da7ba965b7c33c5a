"""benchmarks/: counting, refusals, and each system measured with few messages."""

import os
from pathlib import Path

import pytest

from benchmarks import facade, paced, throughput
from benchmarks.adapters.roles import LAST
from benchmarks.harness import Failure, Group
from benchmarks.startup import FIRST
from benchmarks.systems import (
    BUS,
    BUS_BLOCKING,
    BUS_BYTES,
    BUS_SOCKET,
    BUS_SOCKET_BYTES,
    FLOOR,
    ICEORYX,
    PIPE,
    PYZMQ,
    RCLPY,
    RCLPY_THREADS,
    TWO_HOPS,
    System,
)
from benchmarks.work import Work

pytestmark = pytest.mark.landing

# --- accounting, with a system that says what the test wants

LIAR = """
import os, sys
def tell(text): print(text, flush=True)
tell('{"event": "ready"}')
if sys.argv[1] == "subscriber":
    tell('{"event": "warm"}')
    tell(os.environ["RECEIVED"])
for word in sys.stdin:
    if word.strip() == "go" and "SENT" in os.environ:
        tell(os.environ["SENT"])
"""
FLOOD = Work(size=100, count=1000, warm_up=10)


@pytest.fixture
def liar(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    (tmp_path / "liar_system.py").write_text(LIAR)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv("SENT", '{"event": "sent", "begin_ns": 1000000000}')
    return System("liar", "liar_system")


def _received(count: int, dropped: str = "{}") -> str:
    return f'{{"event": "received", "end_ns": 1500000000, "count": {count}, "dropped": {dropped}}}'


def test_throughput_counts_from_the_first_publish_to_the_last_message(
    liar: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RECEIVED", _received(1010))

    found = throughput.measure(liar, FLOOD)

    assert found["per_s"] == pytest.approx(2000)
    assert found["bytes_per_s"] == pytest.approx(200_000)
    assert found["cpu_broker"] == 0


@pytest.mark.parametrize(
    ("received", "text"),
    [
        (_received(1009), r"1009 of 1010 arrived"),
        (_received(1010, '{"replaced": 1}'), r"dropped: \{'replaced': 1\}"),
    ],
)
def test_a_run_that_lost_something_is_no_throughput(
    liar: System, monkeypatch: pytest.MonkeyPatch, received: str, text: str
) -> None:
    monkeypatch.setenv("RECEIVED", received)

    with pytest.raises(Failure, match=text):
        throughput.measure(liar, FLOOD)


def test_a_system_that_hangs_midway_is_a_failure(liar: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RECEIVED", "nothing yet")
    monkeypatch.setattr(throughput, "_LIMIT_S", 0.2)

    with pytest.raises(Failure, match=r"did not say '(sent|received)'"):
        throughput.measure(liar, FLOOD)


def test_a_match_by_another_route_is_a_failure(liar: System, tmp_path: Path) -> None:
    ready = """print('{"event": "ready", "route": "socket"}', flush=True); input()"""
    (tmp_path / "liar_system.py").write_text(ready)

    with Group() as group:
        assert liar._replace(route="socket").start_role(group, "publisher", FLOOD).is_running()
        with pytest.raises(Failure, match="matched by the route 'socket', not 'shm'"):
            liar._replace(route="shm").start_role(group, "publisher", FLOOD)


# --- real systems, few messages


def _or_skip(system: System) -> System:
    reason = system.missing()
    if reason:
        pytest.skip(reason)
    return system


@pytest.mark.parametrize("system", [BUS, BUS_SOCKET], ids=lambda system: system.route)
@pytest.mark.parametrize(
    ("publish_by", "take_by"), [("publish", "callback"), ("publish", "async for"), ("send", "callback")]
)
def test_throughput_of_busd(system: System, publish_by: str, take_by: str) -> None:
    work = Work(size=64, count=20_000, warm_up=100, publish_by=publish_by, take_by=take_by)

    found = throughput.measure(_or_skip(system), work)

    assert found["cpu_broker"] >= 0
    assert found["lost"] == 0
    assert min(value for key, value in found.items() if key not in ("cpu_broker", "lost")) > 0


@pytest.mark.parametrize(
    ("system", "publish_by", "take_by"),
    [
        (BUS_BYTES, "loan", "views"),
        (BUS_BYTES, "publish", "callback"),
        (BUS_SOCKET_BYTES, "publish", "callback"),
        (ICEORYX, "", "polling"),
        (PYZMQ, "", ""),
    ],
    ids=lambda value: value if isinstance(value, str) else value.name,
)
def test_throughput_of_long_messages(system: System, publish_by: str, take_by: str) -> None:
    work = Work(size=1 << 16, count=200, warm_up=20, publish_by=publish_by, take_by=take_by)

    assert throughput.measure(_or_skip(system), work)["per_s"] > 0


@pytest.mark.parametrize(
    ("system", "take_by"),
    [
        (BUS, "callback"),
        (BUS, "async for"),
        (BUS_SOCKET, "callback"),
        (TWO_HOPS, ""),
        (FLOOR, ""),
        (PIPE, ""),
        (PIPE, "blocking"),
        (PYZMQ, ""),
        (ICEORYX, "event"),
        (ICEORYX, "polling"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.name,
)
def test_latency_of_each_system(system: System, take_by: str) -> None:
    found = paced.measure(_or_skip(system), Work(size=64, count=100, warm_up=10, rate=1000, take_by=take_by))

    assert 0 < found["p50"] <= found["p99"] <= found["max"]
    assert found["due_p50"] >= found["p50"]
    assert found["cpu"] >= found["cpu_publisher"] > 0


@pytest.mark.parametrize("publish_by", ["loan", "publish"])
def test_latency_of_long_messages(publish_by: str) -> None:
    take_by = "views" if publish_by == "loan" else "callback"
    work = Work(size=1 << 20, count=10, warm_up=2, rate=100, publish_by=publish_by, take_by=take_by)

    assert paced.measure(_or_skip(BUS_BYTES), work)["p50"] > 0


@pytest.mark.parametrize("system", [RCLPY, RCLPY_THREADS, BUS], ids=lambda system: system.name)
def test_the_facade_and_its_measure(system: System) -> None:
    timed = Work(size=64, count=100, warm_up=10, rate=1000, publish_by="timer", take_by="callback")
    flood = Work(size=64, count=2000, warm_up=100, publish_by="publish", take_by="callback")
    lossy = Work(size=64, count=2000, warm_up=0, publish_by=LAST, take_by="callback")

    assert paced.measure(_or_skip(system), timed)["p50"] > 0
    assert throughput.measure(system, flood)["per_s"] > 0
    assert 0 < facade.measure_lossy(system, lossy)["delivered"] <= 100


def test_an_action_and_its_messages() -> None:
    _or_skip(RCLPY)
    cpus = sorted(os.sched_getaffinity(0))

    assert facade.measure_round_trips(is_action=True, count=2, cpus=cpus[:1])["p50"] > 0
    assert facade.measure_round_trips(is_action=False, count=2, cpus=cpus[:2])["p50"] > 0


def test_the_start_of_a_talker_and_of_a_listener() -> None:
    found = facade.measure_start(_or_skip(RCLPY), FIRST)

    assert found["talker_ms"] > 0 and found["listener_ms"] > 0


def test_more_than_was_published_is_a_failure(liar: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SENT", '{"event": "sent", "begin_ns": 1000000000, "end_ns": 1100000000}')
    monkeypatch.setenv("RECEIVED", _received(501))
    lossy = Work(size=64, count=1000, warm_up=0, publish_by=LAST)

    found = facade.measure_lossy(liar, lossy)

    assert found == pytest.approx({"per_s": 1002, "published_per_s": 10_000, "delivered": 50.1})
    monkeypatch.setenv("RECEIVED", _received(1001))
    with pytest.raises(Failure, match="1001 of 1000 arrived"):
        facade.measure_lossy(liar, lossy)


def test_latency_with_busy_polling() -> None:
    work = Work(size=64, count=100, warm_up=10, rate=1000, take_by="callback", busy_poll_s=0.002)

    assert paced.measure(_or_skip(BUS), work)["p50"] > 0


def test_latency_without_an_event_loop() -> None:
    work = Work(size=64, count=100, warm_up=10, rate=1000, take_by="blocking")

    assert paced.measure(_or_skip(BUS_BLOCKING), work)["p50"] > 0
