"""`bus web --bag`: a bag that pages and viewers of Foxglove's protocol play, on a bus of its own."""

import re
import signal
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

import pytest

from browser import chromium
from bus.msg.std_msgs import Int64
from bus_bag.storage import BagWriter
from cli import bus, wait_for_graph
from conftest import WAIT_S, Daemon
from playing import LATCHED, START, Sample, write_bag
from recording import Bag, recording, speaking

pytest.importorskip("websockets", reason="the server is made of websockets")

from foxglove_client import NPM_TOPICS, Foxglove, looking, npm_client
from web_clients import Serving, serving

pytestmark = pytest.mark.usefixtures("daemon")


@contextmanager
def opened(bag: Path, *options: str) -> Iterator[tuple[Serving, Path]]:
    """`bus web --bag`, and the socket of its bus."""
    with serving("--bag", str(bag), *options) as server:
        line = server.running.line()
        found = re.fullmatch(r"bag: (\S+), on the bus of: export BUSD_SOCKET=(\S+)", line)
        assert found is not None, line
        assert found[1] == bag.name
        yield server, Path(found[2])


def numbers(folder: Path, *at_ms: int) -> Path:
    return write_bag(folder, [Sample("/x", at, Int64(data=at)) for at in at_ms])


def test_a_recorded_bag_is_played_by_a_page_on_a_bus_of_its_own(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "walk")
    with speaking() as speaker:
        speaker.say("/topic")
        with recording(bag, "/topic") as recorder:
            speaker.say("/topic", *range(5))
            recorder.end(signal.SIGTERM)
        with opened(bag.folder) as (server, socket), server.viewer() as page:
            about = page.hear("recording")
            assert (about["note"], about["bars"]) == ("walk: the recorder lost no messages", [])
            page.say("look", topics={"/topic": []})
            assert page.hear("playback")["status"] == "paused"
            page.hear("graph", lambda told: any(one[1] == "/rosbag2_player" for one in told["nodes"]))
            wait_for_graph(lambda graph: "rosbag2_player" not in {node.name for node in graph.nodes})
            page.say("play", step=True)
            page.hear("playback", lambda told: told["messages"] == 1)
            page.say("play", paused=False)
            page.hear("playback", lambda told: told["status"] == "at end" and told["messages"] == 5)
            page.say("play", step=True)
            assert page.hear("refused")["text"] == "no next message"
            assert socket.exists()
            assert server.running.end(signal.SIGTERM).code == -signal.SIGTERM
    assert not socket.parent.exists()


def test_the_folder_of_a_killed_one_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But no folder of another program, and none whose bus is alive."""
    bag = numbers(tmp_path / "bag", 0)
    with TemporaryDirectory() as folder:  # a short path for sockets
        monkeypatch.setenv("TMPDIR", folder)
        monkeypatch.setattr("tempfile.tempdir", None)
        other = Path(folder) / "busd-1000"
        other.mkdir()
        with opened(bag) as (server, socket):
            assert socket.parent.parent == Path(folder)
            server.running.process.kill()
            server.running.process.wait(WAIT_S)
        with opened(bag) as (second, living):
            assert socket.parent.exists(), "its busd still runs"
            assert bus("daemon", "stop", "--socket", str(socket)).code == 0
            with opened(bag) as (third, _):
                assert not socket.parent.exists()
                assert living.exists()
                third.running.end(signal.SIGTERM)
            second.running.end(signal.SIGTERM)
        assert list(Path(folder).iterdir()) == [other]


def test_a_viewer_controls_it(tmp_path: Path) -> None:
    bag = numbers(tmp_path / "bag", 0, 1000, 2000, 3_600_000)
    with opened(bag) as (server, socket), looking(server) as viewer:
        info = viewer.hear("serverInfo")
        assert "playbackControl" in info["capabilities"]
        assert info["dataStartTime"] == {"sec": START // 10**9, "nsec": START % 10**9}
        assert state(viewer)[:2] == (1, START)
        viewer.subscribe({7: "/x"})
        ask(viewer, "seek", seek_ns=START + 2_000_000_000, pause=True)
        status, at_ns, speed, did_seek, id = state(viewer)
        assert (status, at_ns - START, speed, did_seek, id) == (1, 2_000_000_000, 1.0, True, "seek")
        time_ns, data = 0, b""
        end_s = monotonic() + WAIT_S
        while not data:  # the subscription may not have reached the player yet
            assert monotonic() < end_s
            ask(viewer, "again", seek_ns=START + 2_000_000_000, pause=True)
            with suppress(TimeoutError):
                time_ns, data = next_message(viewer, 1.0)
        assert (time_ns - START, int.from_bytes(data[4:], "little")) == (2_000_000_000, 1000)
        ask(viewer, "go")
        while int.from_bytes(data[4:], "little") == 1000:  # also from the first seek
            time_ns, data = next_message(viewer, WAIT_S)
        assert time_ns - START >= 2_000_000_000 and int.from_bytes(data[4:], "little") == 2000
        assert server.running.end(signal.SIGHUP).code == -signal.SIGTERM
    assert not socket.parent.exists()


def test_an_answer_to_a_viewer_has_the_state_after_the_whole_request(tmp_path: Path) -> None:
    playing, paused, buffering, ended = range(4)
    bag = numbers(tmp_path / "bag", 0, 1000, 2000)
    with opened(bag) as (server, _), looking(server) as viewer:
        assert state(viewer)[0] == paused
        ask(viewer, "first", seek_ns=START, pause=True)  # after it the bag is read
        assert state(viewer)[3:] == (True, "first")
        ask(viewer, "slow", speed=0.5)
        assert state(viewer)[::2] == (playing, 0.5, "slow")
        ask(viewer, "back", seek_ns=START, pause=True)
        assert state(viewer) == (paused, START, 1.0, True, "back")
        ask(viewer, "bad", speed=0.0, seek_ns=START + 10**9)
        assert state(viewer) == (paused, START, 1.0, False, "bad"), "a refused request changes nothing"
        ask(viewer, "on", seek_ns=START + 10**9)
        assert state(viewer) == (buffering, START + 10**9, 1.0, True, "on")
        assert state(viewer)[::2] == (playing, 1.0, "")
        assert state(viewer) == (ended, START + 2 * 10**9, 1.0, False, "")
        ask(viewer, "again", speed=2.0)
        assert state(viewer) == (buffering, START, 2.0, True, "again")
        assert state(viewer)[::2] == (playing, 2.0, "")


def test_the_server_is_described_once_to_each_viewer(tmp_path: Path) -> None:
    """Although the bag's `/clock` comes, which a second viewer finds."""
    with opened(numbers(tmp_path / "bag", 0)) as (server, _):
        for _viewer in range(2):
            with looking(server) as viewer:
                told: list[str] = []
                while "/x" not in viewer.channels or "/clock" not in viewer.channels:
                    frame = viewer.listen()
                    told += [frame["op"]] if isinstance(frame, dict) else []
                assert told.count("serverInfo") == 1


def test_the_client_that_foxglove_has_published(tmp_path: Path) -> None:
    """@foxglove/ws-protocol knows no playback: it is told of none, and gets the bag's messages."""
    sample = Sample("/x", 0, Int64(data=7))
    bag = write_bag(tmp_path / "bag", [sample, sample._replace(at_ms=3_600_000)], qos={"/x": [LATCHED]})
    with opened(bag) as (server, _), server.viewer() as page:
        page.say("play", step=True)
        page.hear("playback", lambda told: told["messages"] == 1)
        assert npm_client(server, NPM_TOPICS, "/x") == ["/x std_msgs/msg/Int64 12"]


def ask(
    viewer: Foxglove, id: str, *, pause: bool = False, speed: float = 1.0, seek_ns: int | None = None
) -> None:
    head = struct.pack("<BBfBQI", 3, pause, speed, seek_ns is not None, seek_ns or 0, len(id))
    viewer.connection.send(head + id.encode())


def state(viewer: Foxglove) -> tuple[int, int, float, bool, str]:
    """The next state: status, time, speed, whether it is a seek, and the request's id."""
    data = viewer.binary(5)
    status, at_ns, speed, did_seek, length = struct.unpack_from("<BQf?I", data)
    assert length == len(data) - 18
    return status, at_ns, speed, did_seek, data[18:].decode()


def next_message(viewer: Foxglove, patience_s: float) -> tuple[int, bytes]:
    """Its time and its data; the frames before it are skipped. Raises TimeoutError."""
    end_s = monotonic() + patience_s
    while True:
        frame = viewer.listen(end_s - monotonic())
        if isinstance(frame, bytes) and frame[0] == 1:
            return struct.unpack_from("<Q", frame, 5)[0], frame[13:]


def test_it_plays_on_the_named_bus_if_one_is_named(daemon: Daemon, tmp_path: Path) -> None:
    bag = numbers(tmp_path / "bag", 0)
    with opened(bag, "--socket", str(daemon.path)) as (_, socket):
        assert socket == daemon.path
        wait_for_graph(lambda graph: "/x" in graph.topics())


def test_mistakes_get_one_line(tmp_path: Path) -> None:
    BagWriter(tmp_path / "empty").close()
    (tmp_path / "no.mcap").write_bytes(b"no bag")
    for name, text in (
        ("none", "none"),
        ("empty", "Nothing to play: empty has no messages"),
        ("no.mcap", "no.mcap"),
    ):
        result = bus("web", "--listen", "127.0.0.1:0", "--bag", str(tmp_path / name))
        assert (result.out, result.code, len(result.err.splitlines())) == ("", 1, 1), result
        assert text in result.err


def test_the_page_has_a_bar(tmp_path: Path) -> None:
    with opened(numbers(tmp_path / "bag", 0, 1000, 3_600_000)) as (server, _), chromium() as page:
        page.open(server.page)
        page.wait("return document.querySelector('#bag').hidden === false")
        shown = "return document.querySelector('#bag [role=status]').textContent"
        page.wait(shown, fits=lambda text: text == "paused")
        assert page.faults() == []
        assert page.texts("#bag .note") == ["bag: it has no record of losses; only bus bag record writes one"]
        page.press("#bag button")
        page.wait(shown, fits=lambda text: text == "playing")
        page.run(
            "const slider = document.querySelector('#bag [type=range]');"
            "for (const at of [100, 200, 1800])"
            "{ slider.value = at; slider.dispatchEvent(new Event('input')); }"
        )
        time: Any = "return document.querySelector('#bag span').textContent"
        page.wait(time, fits=lambda text: text.startswith("30:0"))
        page.press("#bag button")
        page.wait(shown, fits=lambda text: text == "paused")
        page.press("#bag button + button")
        page.wait(time, fits=lambda text: text.startswith("60:00.0 / 60:00.0"))
        page.wait(shown, fits=lambda text: text == "at end")
        page.run(
            "const speed = document.querySelector('#bag [type=number]');"
            "speed.value = 0; speed.dispatchEvent(new Event('change'));"
        )
        page.wait(shown, fits=lambda text: text == "0 is not a rate from 1e-9 to 1e9")
        assert page.run("return document.querySelector('#bag [type=number]').value") == "1"
        assert page.console() == []
