"""`bus top` as users run it: every key, its output and its end, with a real busd."""

import json
import re
import signal
import socket
from argparse import Namespace
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

import bus
import bus.link.query
import bus.link.requests
from bus.msg.std_msgs import Float64MultiArray, Int64, String
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus_cli.query import Query
from bus_cli.stream import open_node
from bus_cli.top import plain
from bus_cli.top.state import State
from cli import bus as run_bus
from cli import script, start
from conftest import WAIT_S, Daemon
from neighbours import wait_until
from raw_peer import RawPeer
from terminals import OwnTerminal

pytest.importorskip("textual", reason="bus top's screen is textual's")

from textual.pilot import Pilot

from bus_cli.top.lines_view import LinesView
from bus_cli.top.screen import Top

WORLD = """
import asyncio, bus
from bus.msg.std_msgs import Int64, String
async def main():
    async with bus.Node("talker") as talker, bus.Node("listener", namespace="/ear") as listener:
        chatter = await talker.create_publisher(String, "/chatter", 10)
        await talker.create_publisher(Int64, "/odd", bus.QoSProfile(5, reliability="best_effort"))
        await talker.create_publisher(String, "/_hidden/b", 10)
        await listener.create_subscription(String, "/chatter", 10, lambda message: None)
        await listener.create_subscription(String, "/chatter", 2)
        await listener.create_subscription(Int64, "/odd", 10)
        print("ready", flush=True)
        for number in range(1_000_000):
            if number < 100:
                chatter.publish(String(data=f"Hello World: {number}"))
            await asyncio.sleep(0.01)
bus.run(main())
"""
"""A hundred messages, of which a subscription loses 98; and two endpoints that don't match."""


@pytest.fixture
def world(daemon: Daemon) -> Iterator[None]:
    with script(WORLD):
        yield


# --- without a screen


def test_once_says_what_topic_info_says(world: None) -> None:
    def info(topic: str) -> Any:
        return json.loads(run_bus("topic", "info", "-v", topic, "--json").out)

    while sum(one["messages"] for one in info("/chatter")["subscriptions"]) < 100:
        pass
    result = run_bus("top", "--once", "--json", "-d", "0.3", "--sort", "lost")
    assert (result.code, result.err) == (0, "")
    seen = json.loads(result.out)
    assert [row["topic"] for row in seen["rows"]] == ["/chatter", "/odd", "/rosout"]
    assert (seen["nodes"], seen["topics"], seen["lost"]) == (2, 3, 98)
    for row in seen["rows"]:
        told = info(row["topic"])
        assert row["types"] == told["types"]
        for kind in ("publisher", "subscription"):
            mine = [one for one in row["endpoints"] if one["kind"] == kind]
            assert row[f"{kind}s"] == len(mine) == told[f"{kind}_count"]
            for one, other in zip(mine, told[f"{kind}s"], strict=True):
                for name in ("node", "pid", "qos", "messages", "bytes", "queued", "dropped"):
                    assert one[name] == other[name], (row["topic"], name)
                assert one["type_name"] == other["type"]
        reasons = {
            match["reason"] for one in told["publishers"] for match in one["matches"] if "reason" in match
        }
        assert {one["reason"] for one in row["no_match"]} == reasons
        assert row["mismatches"] == len(row["no_match"])
    chatter, odd, _ = seen["rows"]
    assert (chatter["lost"], chatter["dropped"], chatter["queued"], chatter["depth"]) == (
        98, {"replaced": 98}, 2, 2,
    )  # fmt: skip
    assert odd["no_match"] == [
        {"publisher": "/talker", "subscription": "/ear/listener", "reason": odd["no_match"][0]["reason"]}
    ]


def test_once_is_a_table(world: None) -> None:
    result = run_bus("top", "--once", "-d", "0.3", "--include-hidden-topics")
    assert (result.code, result.err) == (0, "")
    sums, _, title, *rows = result.out.splitlines()
    assert re.match(r"2 nodes, \d+ topics, .* messages/s, ", sums)
    assert title.split()[:3] == ["TOPIC", "TYPE", "HZ"]
    assert [row.split()[0] for row in rows][:3] == ["/_hidden/b", "/chatter", "/odd"]
    assert "1 pair does not match" in rows[2]


def test_an_object_every_so_often_until_a_signal(world: None) -> None:
    with start("top", "--json", "-d", "0.2") as running:
        times = [json.loads(running.line())["time"] for _ in range(3)]
        assert times[0] < times[1] < times[2]
        assert running.end(signal.SIGINT).code == -signal.SIGINT


def test_objects_go_on_over_a_restart(daemon: Daemon, start_daemon: Callable[..., Daemon]) -> None:
    """busd is away for a while, and only its owner may start it."""
    with start("top", "--json", "-d", "0.2") as running:
        running.line()
        daemon.stop()
        assert "looking for it again" in running.error_line()
        start_daemon()
        json.loads(running.line())


def test_once_of_one_that_answers_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """It reports that and ends: a user who wants one look does not wait for a later one."""
    ours, theirs = socket.socketpair()
    ours.sendall(m.encode_frame(m.Hello(version=PROTOCOL_VERSION)))
    monkeypatch.setattr(bus.link.query, "try_to_connect", lambda path: theirs)
    monkeypatch.setattr(plain, "Query", partial(Query, answer_s=0.05))
    with ours, pytest.raises(bus.BrokerUnavailable, match=r"^busd at x does not answer: "):
        next(plain.looks(Path("x"), 0.1, is_once=True))


def test_objects_of_one_that_answers_no_more(
    daemon: Daemon, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It reports that once, and continues when busd answers again."""
    tries: list[Path] = []

    def query(path: Path) -> Query:
        tries.append(path)
        if len(tries) == 6:
            daemon.process.send_signal(signal.SIGCONT)
        return Query(path, answer_s=0.1)

    monkeypatch.setattr(plain, "Query", query)
    with closing(plain.looks(daemon.path, 0.01, is_once=False)) as looks:
        next(looks)
        daemon.process.send_signal(signal.SIGSTOP)
        next(looks)
    assert len(tries) >= 6
    text = f"busd at {daemon.path} does not answer: it has said nothing for 0.1 s; looking for it again"
    assert capsys.readouterr().err == f"{text}\n"


def test_no_daemon_and_none_may_be_started(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    result = run_bus("top", "--once")
    assert (result.out, result.code) == ("", 1)
    assert result.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ((), "bus top needs a terminal; without one, use --once or --json"),
        (("--sort", "lots"), r"no column 'lots' to sort by: topic, type, hz, .*; did you mean 'lost'\?"),
        (("-d", "0"), "value must be a positive number"),
        (("-d", "0.01"), "the period must be from 0.1 to 3600 s, not 0.01"),
    ],
)
def test_mistakes(daemon: Daemon, words: tuple[str, ...], why: str) -> None:
    result = run_bus("top", *words)
    assert re.search(f"{why}\n$", result.err), result.err
    assert result.code == (2 if words else 1)


# --- on a screen


class Screen:
    """The running program."""

    def __init__(self, top: Top, pilot: Pilot[None]) -> None:
        self.top, self.pilot = top, pilot

    def text(self, part: str = "") -> str:
        """The text of one part of the screen, or of all of it."""
        strips = self.top.screen._compositor.render_strips()
        region = self.top.screen.region if not part else self.top.query_one(f"#{part}").region
        lines = ["".join(segment.text for segment in strip) for strip in strips]
        return "\n".join(
            line[region.x : region.right].rstrip() for line in lines[region.y : region.bottom]
        ).rstrip()

    async def until(self, pattern: str, part: str = "") -> str:
        """Wait until the text has the pattern; the whole text then."""
        end = monotonic() + WAIT_S
        while not re.search(pattern, shown := self.text(part)):
            assert monotonic() < end, self.text()
            await self.pilot.pause(0.02)
        return shown

    async def press(self, *keys: str) -> None:
        await self.pilot.press(*keys)

    def rows(self) -> list[str]:
        """The first word of each row."""
        return [line.text.split()[0] for line in self.top.query_one("#rows", LinesView)._lines]


@asynccontextmanager
async def screen(size: tuple[int, int] = (160, 40), by: str = "topic") -> AsyncIterator[Screen]:
    async with open_node(Namespace(socket=None, domain=None)) as node:
        top = Top(node, 0.1, State(by))
        async with top.run_test(size=size) as pilot:
            yield Screen(top, pilot)
        assert top.failure is None


async def test_every_key(world: None) -> None:
    async with screen() as shown:
        await shown.until("/chatter .* 2/2 .* 98 +[▁-█ ]*has lost: replaced", "rows")
        assert shown.rows() == ["/chatter", "/odd", "/rosout"]
        assert "2 nodes, 3 topics" in shown.text("sums")
        await shown.until(r"/talker +pub +\d+ +100 .*keep last 10, reliable", "below")
        await shown.until(r"/ear/listener +sub +\d+ .* 2/2 .*98 \(replaced: 98\)", "below")
        await shown.press("down")
        await shown.until("no match: /talker -> /ear/listener: ERROR: Best effort publisher", "below")
        await shown.press("s", "s")
        await shown.until(r"\[HZ\]", "titles")
        assert shown.top._state.chosen.topic == "/odd"
        await shown.press("r")
        await shown.until("reversed", "sums")
        await shown.press("h")
        await shown.until("hidden ones too", "sums")
        assert "/_hidden/b" in shown.rows()
        await shown.press("h", "n")
        await shown.until(r"/ear/listener .* 98 ", "rows")
        assert set(shown.rows()) == {"/talker", "/ear/listener"}
        await shown.until(r"process \d+", "about")
        await shown.press("n", "space")
        await shown.until("paused", "sums")
        await shown.press("space")
        await shown.press("question_mark")
        await shown.until("Any key closes this")
        await shown.press("x")
        await shown.until("/chatter", "rows")
        await shown.press(
            "end", "pageup", "home", "j", "k", "pagedown", "tab", "down", "end", "home", "shift+tab"
        )
        assert shown.top.query_one("#rows").has_focus
        await shown.press("q")
    assert not shown.top.is_running


@pytest.mark.parametrize(("size", "first"), [((40, 10), "up down"), ((80, 24), "up, down")])
async def test_help_fits(daemon: Daemon, size: tuple[int, int], first: str) -> None:
    async with screen(size) as shown:
        await shown.press("question_mark")
        lines = (await shown.until("Any key closes this")).splitlines()
        assert any(line.strip("│ ").startswith(first) for line in lines)
        assert lines[-1].strip()[0] == "╰" or size == (80, 24)
        assert all(line.endswith(("╮", "│", "╯")) for line in lines if "│" in line), "no line is cut"


async def test_a_filter(world: None) -> None:
    async with screen() as shown:
        await shown.until("/rosout", "rows")
        await shown.press("slash", *"chat")
        await shown.until("only with 'chat'", "sums")
        assert shown.rows() == ["/chatter"]
        assert shown.text("filter") == "chat"
        await shown.press("enter", "down")
        assert shown.rows() == ["/chatter"]
        await shown.press("escape")
        await shown.until("/rosout", "rows")
        await shown.press("slash", *"q", "escape")
        await shown.until("(?s)/chatter.*/odd.*/rosout", "rows")


async def test_live_values(daemon: Daemon) -> None:
    async with bus.Node("talker") as node, screen() as shown:
        numbers = await node.create_publisher(Int64, "/numbers", 10)
        arrays = await node.create_publisher(Float64MultiArray, "/arrays", 10)
        await shown.until("(?s)/arrays.*/numbers", "rows")
        await shown.press("down", "enter")
        await shown.until("no message yet", "below")
        await numbers.wait_for_subscriptions()
        numbers.publish(Int64(data=41))
        await shown.until("data: 41", "below")
        numbers.publish(Int64(data=42))
        await shown.until("data: 42", "below")
        await shown.until("/numbers  message 2, .* old on arrival", "about")
        assert (await node.graph()).subscriptions_of("/numbers")
        assert " 0 " in next(line for line in shown.text("rows").splitlines() if "/numbers" in line)
        await shown.press("up")
        await shown.until("keep last 10, reliable", "below")
        await shown.press("enter")
        await arrays.wait_for_subscriptions()
        arrays.publish(Float64MultiArray(data=[float(number) for number in range(36)]))
        text = await shown.until("- 7.0", "below")
        assert "- 8.0" not in text
        await shown.press("enter")
        await shown.until("keep last 10, reliable", "below")
        await node.wait_for_graph(lambda graph: not graph.subscriptions_of("/arrays"))
        await shown.press("n", "enter", "n")
        await shown.press("escape")


async def test_what_has_several_types_has_no_values(daemon: Daemon) -> None:
    async with bus.Node("talker") as node, screen() as shown:
        await node.create_publisher(Int64, "/mixed", 10)
        await node.create_subscription(String, "/mixed", 10)
        await shown.until("/mixed +std_msgs/Int64, std_msgs/String", "rows")
        await shown.press("enter")
        await shown.until("as it contains more than one type", "below")


async def test_types_of_one_name_that_differ_are_told_apart(daemon: Daemon) -> None:
    program = """
import asyncio, bus, msgspec
from typing import ClassVar
class Wheel(msgspec.Struct):
    __type_name__: ClassVar[str] = "demo/msg/Wheel"
    {field}: float
async def main():
    async with bus.Node("{node}") as node:
        await node.create_{end}(Wheel, "/wheel", 10)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
    with (
        script(program.format(field="speed", node="a", end="publisher")),
        script(program.format(field="angle", node="b", end="subscription")),
    ):
        async with screen() as shown:
            await shown.until("/wheel", "rows")
            await shown.press("end")
            await shown.until("(?s)/a -> /b.*both call it demo/msg/Wheel, but .*(speed|angle)", "below")


async def test_busd_goes_and_comes(daemon: Daemon, start_daemon: Callable[..., Daemon]) -> None:
    async with screen() as shown:
        await shown.until("/rosout|nothing lost", "sums")
        shown.top._delay_s = 0.1
        daemon.stop()
        await shown.until("busd does not answer", "sums")
        start_daemon()
        async with bus.Node("talker") as node:
            await node.create_publisher(Int64, "/numbers", 10)
            await shown.until("/numbers", "rows")
            await shown.until("nothing lost", "sums")


async def test_a_reason_that_a_terminal_would_obey(daemon: Daemon) -> None:
    with RawPeer(daemon.path) as peer:
        end = peer.hello().subscription(peer.node(), "/topic").id
        peer.send(m.Report(end, 1, 1, dropped={"\x1b[2J": 7}, at_ns=1))
        peer.barrier()
        async with screen() as shown:
            await shown.until(r"has lost: \\x1b\[2J", "rows")
            await shown.until(r"7 \(\\x1b\[2J: 7\)", "below")


async def test_when_messages_were_lost(daemon: Daemon) -> None:
    async with screen() as shown, bus.Node("talker") as node:
        publisher = await node.create_publisher(Int64, "/numbers", 10)
        await node.create_subscription(Int64, "/numbers", 2)  # no program takes its messages
        await shown.until("/numbers .* 1 +1 ", "rows")
        for number in range(10):
            publisher.publish(Int64(data=number))
        await shown.until("8 ▁*█▁* +(loses now|has lost): replaced", "rows")
        await shown.until(r"8 \(replaced: 8\) ▁*█▁* ", "below")


async def test_ages(daemon: Daemon) -> None:
    async with screen() as shown, bus.Node("talker") as node:
        publisher = await node.create_publisher(Int64, "/numbers", 10)
        subscription = await node.create_subscription(Int64, "/numbers", 10)
        await shown.until("/numbers .* 1 +1 ", "rows")
        publisher.publish(Int64(data=1))
        await subscription.receive()
        await shown.until(r"/numbers .* (\d+|\d+\.\d) (µs|ms) +(\d+|\d+\.\d) (µs|ms) ", "rows")


async def test_busd_stands_still(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """busd stops for longer than `bus top` waits for an answer."""
    async with screen() as shown:
        await shown.until("/rosout|nothing lost", "sums")
        monkeypatch.setattr(bus.link.requests, "ANSWER_S", 0.1)
        daemon.process.send_signal(signal.SIGSTOP)
        await shown.until("busd does not answer", "sums")
        daemon.process.send_signal(signal.SIGCONT)
        async with bus.Node("talker") as node:
            await node.create_publisher(Int64, "/numbers", 10)
            await shown.until("/numbers", "rows")


@pytest.mark.parametrize("width", [20, 80])
async def test_narrow_terminals(world: None, width: int) -> None:
    async with screen((width, 24)) as shown:
        text = await shown.until("loses now|has lost" if width > 60 else "/cha")
        assert all(len(line) <= width for line in text.splitlines())
        await shown.pilot.resize_terminal(160, 10)
        await shown.until("TYPE", "titles")


# --- at a terminal


@contextmanager
def terminal(*options: str, **environ: str) -> Iterator[OwnTerminal]:
    words = "".join(f"import os; os.environ[{name!r}] = {value!r}; " for name, value in environ.items())
    program = (
        f"{words}import sys; sys.argv = ['bus', 'top', *{options!r}]; from bus_cli.main import main; main()"
    )
    with OwnTerminal("-c", program) as terminal:
        yield terminal


@pytest.mark.parametrize(("keys", "code"), [("q", 0), ("\x03", -signal.SIGINT)])
def test_the_terminal_is_put_back(world: None, keys: str, code: int) -> None:
    with terminal("-d", "0.2") as shown:
        before = shown.mode()
        shown.read_until("chatter")
        assert shown.is_raw()
        shown.write(keys)
        shown.read_until(re.escape("\x1b[?1049l"))
        assert shown.wait() == code
        assert shown.mode() == before


def test_what_is_typed_and_is_no_text(world: None) -> None:
    with terminal("-d", "0.2") as shown:
        shown.read_until("chatter")
        shown.write(b"\x1b[M \xff\xfe\xe9n")
        shown.read_until(r"\[NODE\]")
        shown.write("q")
        shown.read_until(re.escape("\x1b[?1049l"))
        assert shown.wait() == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.nightly)])
def test_the_terminal_is_put_back_after_a_signal(world: None, number: int) -> None:
    with terminal("-d", "0.2") as shown:
        before = shown.mode()
        shown.read_until("chatter")
        shown.send_signal(number)
        shown.read_until(re.escape("\x1b[?1049l"))
        assert shown.wait() == -number
        assert shown.mode() == before


def test_it_is_stopped_and_goes_on(world: None) -> None:
    def is_stopped() -> bool:
        return Path(f"/proc/{shown._pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"

    with terminal("-d", "0.2") as shown:
        shown.read_until("chatter")
        shown.write("\x1a")
        shown.read_until(re.escape("\x1b[?1049l"))
        wait_until(is_stopped)
        assert not shown.is_raw()
        shown.send_signal(signal.SIGCONT)
        shown.read_until("chatter")
        assert shown.is_raw()
        shown.write("q")
        assert shown.wait() == 0


def test_a_terminal_without_utf_8(world: None) -> None:
    with terminal("-d", "0.2", LC_ALL="C") as shown:
        seen = shown.read_until(r"has lost: replaced(?s:.*) u?s ")
        shown.write("q")
        shown.wait()
    assert seen.isascii()


def test_a_dumb_terminal(world: None) -> None:
    """It gets the table again and again, and no escape sequence."""
    with terminal("-d", "0.2", TERM="dumb") as shown:
        seen = "".join(shown.read_until(r"TOPIC(?s:.*)has lost: repl") for _ in range(2))
        shown.write("\x03")
        assert shown.wait() == -signal.SIGINT
    assert seen.isascii()
    assert "\x1b" not in seen


@pytest.mark.parametrize("no_color", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_no_color(world: None, no_color: bool) -> None:
    with terminal("-d", "0.2", **({"NO_COLOR": "1"} if no_color else {})) as shown:
        seen = shown.read_until("has lost: replaced")
        shown.write("q")
        shown.wait()
    colours = re.findall(r"\x1b\[(?:\d+;)*(?:3[0-7]|38;[\d;]+|4[0-7]|48;[\d;]+|9[0-7])m", seen)
    assert bool(colours) != no_color, colours


def test_without_textual(daemon: Daemon) -> None:
    hide = "import sys; sys.modules['textual'] = None; sys.modules['textual.app'] = None; "
    with OwnTerminal(
        "-c", f"{hide}sys.argv = ['bus', 'top']; from bus_cli.main import main; main()"
    ) as shown:
        shown.read_until(
            r"bus top needs textual \(.*\): pip install 'textual>=3'; --once and --json work without it\r\n"
        )
        assert shown.wait() == 1


def test_a_bus_that_may_not_be_used(tmp_path: Path) -> None:
    path = tmp_path / "no_socket"
    path.mkdir()
    with terminal("--socket", str(path)) as shown:
        shown.read_until(re.escape(str(path)))
        assert shown.wait() == 1
