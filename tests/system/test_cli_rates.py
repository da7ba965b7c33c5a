"""`bus topic hz`, `bw` and `delay`, against the texts of the real `ros2`."""

import re
import signal
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import pytest

from cli import TALKER, Result, Running, bus, messages_on_topic, script, start, wait_for_graph

T = TypeVar("T")

NUMBER = r"\d+\.\d"
HZ = (
    rf"average rate: {NUMBER}{{3}}\n"
    rf"\tmin: {NUMBER}{{3}}s max: {NUMBER}{{3}}s std dev: {NUMBER}{{5}}s window: \d+\n"
)
FLOW = rf"\tpublished: {NUMBER}{{3}} received: {NUMBER}{{3}}( dropped: .+)?"
REPORTS = 20
"""So many reports, one a second, may be wrong because the machine is busy."""

STAMPER = """
import asyncio, time, bus
from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import Header
from bus.msg.geometry_msgs import PointStamped
async def main():
    async with bus.Node("stamper") as node:
        publisher = await node.create_publisher(PointStamped, "topic", 10)
        print("ready", flush=True)
        for _ in range(1_000_000):
            sec, nanosec = divmod(time.time_ns() - 250_000_000, 10**9)
            publisher.publish(PointStamped(header=Header(stamp=Time(sec=sec, nanosec=nanosec))))
            await asyncio.sleep(0.05)
bus.run(main())
"""


UNSTAMPED = """
import asyncio, bus, msgspec
class Mail(msgspec.Struct):
    header: str = "Dear reader"
async def main():
    async with bus.Node("mailer") as node:
        publisher = await node.create_publisher(Mail, "topic", 10)
        print("ready", flush=True)
        while True:
            publisher.publish(Mail())
            await asyncio.sleep(0.05)
bus.run(main())
"""


def number(text: str, name: str) -> float:
    found = re.search(rf"{name}: ([0-9.]+)", text)
    assert found is not None, text
    return float(found[1])


def report_that(fits: Callable[[T], object], read: Callable[[], T]) -> T:
    """The first report that fits: a stall makes messages arrive in a burst; later reports even that out."""
    seen = []
    for _ in range(REPORTS):
        seen.append(read())
        if fits(seen[-1]):
            return seen[-1]
    pytest.fail(f"none of {seen}")


def hz_lines(running: Running) -> str:
    """A report that includes the publishers' rate, which is known after a second."""
    lines = [running.line_with("average")]
    while not lines[-1].startswith("\tpublished"):
        line = running.line()
        lines = [line] if line.startswith("average") else [*lines, line]
    return "".join(f"{line}\n" for line in lines)


def json_line(running: Running) -> Any:
    return msgspec.json.decode(running.line())


def test_hz(daemon: object) -> None:
    def fits(text: str) -> bool:
        """No message is lost, so both ends have the same rate."""
        published, received = number(text, "published"), number(text, "received")
        return 0 < number(text, "average rate") < 11 and 8 < published == received < 10.5

    with script(TALKER, "0.1"), start("topic", "hz", "/topic") as running:
        first = hz_lines(running)
        second = report_that(fits, lambda: hz_lines(running))
        assert re.fullmatch(HZ + FLOW + "\n", first)
        assert re.fullmatch(HZ + FLOW + "\n", second)
        assert running.end(signal.SIGINT).code == -signal.SIGINT
    assert number(second, "window") > number(first, "window")


def test_hz_window(daemon: object) -> None:
    with script(TALKER, "0.05"), start("topic", "hz", "/topic", "-w", "3", "--wall-time") as running:
        report_that(lambda text: number(text, "window") == 3, lambda: running.line_with("window"))


def test_hz_filter(daemon: object) -> None:
    """It measures one in five messages and receives all."""

    def fits(record: Any) -> bool:
        received_hz = record["received_hz"]
        return received_hz is not None and record["rate"] == pytest.approx(received_hz / 5, rel=0.5)

    expression = "m.data[-1:] in ('0', '5')"
    with (
        script(TALKER, "0.05"),
        start("topic", "hz", "/topic", "--filter", expression, "--json") as running,
    ):
        report_that(fits, lambda: json_line(running))


def test_hz_of_several_topics(daemon: object) -> None:
    with (
        script(TALKER, "0.05"),
        start("topic", "pub", "/other", "std_msgs/msg/String", "-r", "20", "-p", "0"),
        start("topic", "hz", "/topic", "/other") as running,
    ):
        assert running.lines(2) == "Subscribed to [/topic]\nSubscribed to [/other]\n"
        # The first tables may lack one of them.
        table: list[str] = []
        while len(table) != 4:
            table = [running.line()]
            while line := running.line():
                table.append(line)
    head, line, topic, other = table
    assert head.split() == ["topic", "rate", "min_delta", "max_delta", "std_dev", "window"]
    assert set(line) == {"="}
    assert len(line) >= len(head)
    row = rf"{NUMBER}{{3}} +{NUMBER}{{3}} +{NUMBER}{{3}} +{NUMBER}{{5}} +\d+ *"
    assert re.fullmatch(rf"/topic +{row}", topic)
    assert re.fullmatch(rf"/other +{row}", other)


def test_hz_in_json(daemon: object) -> None:
    with script(TALKER, "0.1"), start("topic", "hz", "/topic", "/topic", "--json") as running:
        record = json_line(running)
    assert set(record) == {
        *("topic", "rate", "min_s", "max_s", "std_dev_s", "window"),
        *("published_hz", "received_hz", "dropped"),
    }
    assert record["topic"] == "/topic"


def test_hz_tells_published_from_received(route: str, daemon: object) -> None:
    words = ("topic", "pub", "/topic", "std_msgs/msg/String", "-r", "200", "-p", "0")
    with (
        start(*words, f"data: {'x' * 60_000}") as talker,
        start("topic", "hz", "/topic", "--json", "--qos-depth", "1") as running,
    ):
        talker.line()
        running.line()
        running.process.send_signal(signal.SIGSTOP)
        before = messages_on_topic(wait_for_graph(messages_on_topic))
        wait_for_graph(lambda graph: messages_on_topic(graph) >= before + 50)
        running.process.send_signal(signal.SIGCONT)
        # The two ends report their counters at different times.
        report_that(
            lambda record: (
                record["dropped"].get("replaced")
                and (record["received_hz"] or 0) < (record["published_hz"] or 0)
            ),
            lambda: json_line(running),
        )


@pytest.mark.parametrize("verb", ["hz", "bw", "delay"])
def test_they_wait_for_the_topic(daemon: object, verb: str) -> None:
    with start("topic", verb, "/topic") as running:
        assert running.error_line() == "WARNING: topic [/topic] does not appear to be published yet"
        with script(STAMPER):
            assert running.line()
        assert running.end(signal.SIGTERM).code == -signal.SIGTERM


def test_bw(daemon: object) -> None:
    with script(TALKER, "0.1"), start("topic", "bw", "/topic", "-w", "50") as running:
        assert running.line() == "Subscribed to [/topic]"
        pattern = r"\d+ B/s from \d+ messages\n\tMessage size mean: \d+ B min: \d+ B max: \d+ B\n"
        text = report_that(re.compile(pattern).fullmatch, lambda: running.lines(2))
    assert 16 <= number(text, "mean") <= 18


def test_bw_in_json(daemon: object) -> None:
    with script(TALKER, "0.05"), start("topic", "bw", "/topic", "--json", "-w", "5") as running:
        record = report_that(lambda record: record["messages"] == 5, lambda: json_line(running))
    assert set(record) == {"topic", "bytes_per_s", "messages", "mean", "min", "max"}


def test_bw_in_larger_units(daemon: object) -> None:
    words = ("topic", "pub", "/topic", "std_msgs/msg/String", "-r", "100", "-p", "0")
    pattern = r"\d+\.\d\d MB/s from \d+ messages\n\tMessage size mean: 0\.06 MB min: 0\.06 MB"
    with start(*words, f"data: {'x' * 60_000}"), start("topic", "bw", "/topic") as running:
        assert running.line() == "Subscribed to [/topic]"
        report_that(re.compile(pattern).match, lambda: running.lines(2))


def delay_lines(running: Running) -> str:
    return f"{running.line_with('average')}\n{running.line()}\n"


def test_delay(daemon: object) -> None:
    with script(STAMPER), start("topic", "delay", "/topic") as running:
        first, second = delay_lines(running), delay_lines(running)
    shape = HZ.replace("rate", "delay")
    assert re.fullmatch(shape, first)
    assert re.fullmatch(shape, second)
    assert number(first, "min") >= 0.25
    assert number(second, "window") > number(first, "window")


def test_delay_window_and_json(daemon: object) -> None:
    with script(STAMPER), start("topic", "delay", "/topic", "-w", "3", "--json") as running:
        record = report_that(lambda record: record["window"] == 3, lambda: json_line(running))
    assert record["topic"] == "/topic"
    assert record["delay_s"] >= 0.25


def test_delay_as_a_histogram(daemon: object) -> None:
    with script(STAMPER), start("topic", "delay", "/topic", "--histogram") as running:
        running.line_with("min: ")
        found = re.fullmatch(r"\tp50: (\d\.\d{6})s p99: (\d\.\d{6})s", running.line())
        assert found is not None
        assert 0.25 <= float(found[1]) <= float(found[2])
        assert re.fullmatch(r"\t *\d+ ms \.\.\. \d+ ms ▇* +\d+", running.line())
    with script(STAMPER), start("topic", "delay", "/topic", "-w", "3", "--json", "--histogram") as running:
        record = report_that(lambda record: record["window"] == 3, lambda: json_line(running))
    assert 0.25 <= record["p50_s"] <= record["p99_s"] == record["max_s"]
    assert sum(count for _, _, count in record["histogram"]) == 3
    assert record["histogram"][0][0] <= record["min_s"] < record["histogram"][0][1]


def test_delay_says_when_nothing_is_new(daemon: object) -> None:
    with script(STAMPER) as stamper, start("topic", "delay", "/topic") as running:
        delay_lines(running)
        stamper.process.send_signal(signal.SIGSTOP)
        assert running.line_with("no new") == "no new messages"
        stamper.process.send_signal(signal.SIGCONT)


def test_delay_needs_a_header(daemon: object) -> None:
    with script(TALKER, "1"):
        assert bus("topic", "delay", "/topic") == Result("", "msg does not have header\n", 1)
    with script(UNSTAMPED):
        assert bus("topic", "delay", "/topic") == Result("", "header of msg does not have stamp\n", 1)
