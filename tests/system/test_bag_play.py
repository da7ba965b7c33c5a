"""Bags are played: order, times, QoS, latched state, pauses, seeks, and all that services do."""

import re
import signal
import time
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import Int64, String
from bus_cli import main
from cli import start
from conftest import Daemon
from playing import Audience, Sample, replay, write_bag
from semantics import node

__all__ = ["node"]


@pytest.fixture
def audience(daemon: Daemon, node: bus.Node) -> Audience:
    return Audience(node)


def counted(count: int, step_ms: float = 5.0, topic: str = "/numbers") -> list[Sample]:
    return [Sample(topic, number * step_ms, Int64(data=number)) for number in range(count)]


@pytest.mark.usefixtures("route")
async def test_all_messages_come_in_order_at_their_times_and_with_their_stamps(
    audience: Audience, tmp_path: Path
) -> None:
    bag = write_bag(
        tmp_path / "bag", [*counted(40), Sample("/words", 201, String(data="end"), published_ms=190.5)]
    )
    await audience.listen(Int64, "/numbers")
    await audience.listen(String, "/words")
    begin = time.monotonic()
    async with replay(audience.node, bag) as player:
        await player.task
    assert time.monotonic() - begin >= 0.2
    await audience.has_heard(41)
    assert audience.texts() == [*range(40), "end"]
    assert [one.source_ms for one in audience.heard] == [*(5.0 * number for number in range(40)), 190.5]


LOGGED = r"^\[(?:INFO|WARN)\] \[\d+\.\d{9}\] \[rosbag2_player\]: "


def test_the_program(daemon: Daemon, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", counted(20, 1.0))
    with start("bag", "play", str(tmp_path / "bag"), "-v", "-r", "2", is_fresh=True) as player:
        result = player.end()
    assert (result.out, result.code) == ("", 0)
    lines = [re.sub(LOGGED, "", line) for line in result.err.splitlines()]
    assert lines[:-1] == [
        "Set rate to 2",
        "stdin is not a terminal device. Keyboard handling disabled.",
        "Playback until timestamp: -1",
    ]
    assert re.fullmatch(r"Lateness: p50 .* ms, p99 .* ms, max .* ms \(20 messages\)", lines[-1])


def test_ctrl_c_ends_it_without_a_traceback(daemon: Daemon, tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", counted(2, 3_600_000.0))
    with start("bag", "play", str(tmp_path / "bag")) as player:
        player.error_line_with("Playback until")
        result = player.end(signal.SIGINT)
    assert (result.out, result.err, result.code) == ("", "", -signal.SIGINT)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("none",), "Bag path 'none' does not exist!"),
        (("bag", "-e", "("), "'(' is no regular expression: "),
        (("bag", "-m", "x"), "--remap"),
        (("bag", "--qos-profile-overrides-path", "qos.yaml"), "[ERROR] [ros2bag]: Unexpected key `dep` for"),
        (("bag", "--qos-profile-overrides-path", "none.yaml"), "No such file or directory: 'none.yaml'"),
    ],
)
def test_mistakes(
    socket_path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, ...],
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_bag(Path("bag"), counted(1))
    Path("qos.yaml").write_text("/numbers: {dep: 3}")
    assert main.run(["bag", "play", *words]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line
