"""Hints of `bus` for typing errors and for types that differ."""

import os
import pty
import signal
from contextlib import suppress

from cli import LISTENER, Result, begin, bus, script, start
from conftest import WAIT_S, Daemon

WHEEL = """
import asyncio, sys, bus, msgspec
class Wheel(msgspec.Struct):
    __type_name__ = "demo/msg/Wheel"
    speed: {kind}
async def main():
    async with bus.Node("{name}") as node:
        await node.create_{end}(Wheel, "wheel", 10)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


NEAR_NAMES = {
    "topic info /tpic": ("Unknown topic '/tpic'; did you mean '/topic'?\n", 1),
    "topic info tpic": ("Unknown topic 'tpic'; did you mean '/topic'?\n", 1),
    "topic type /tpic": ("Unknown topic '/tpic'; did you mean '/topic'?\n", 1),
    "topic type /nosuch": ("", 1),
    "topic echo /tpic": (
        "WARNING: topic [/tpic] does not appear to be published yet; did you mean '/topic'?\n"
        "Could not determine the type for the passed topic\n",
        1,
    ),
    "topic pub /topic std_msgs/msg/Strin": (
        "The passed message type is invalid; did you mean 'std_msgs/msg/String'?\n",
        1,
    ),
    "topic find std_msgs/Strng": (
        "no topic has the type 'std_msgs/msg/Strng'; did you mean 'std_msgs/msg/String'?\n",
        0,
    ),
    "node info /minmal_subscriber": (
        "Unable to find node '/minmal_subscriber'; did you mean '/minimal_subscriber'?\n",
        1,
    ),
    "param list minimal_subscribr": ("Node not found; did you mean '/minimal_subscriber'?\n", 1),
}


def test_the_nearest_name(daemon: object) -> None:
    with script(LISTENER):
        assert {line: bus(*line.split()) for line in NEAR_NAMES} == {
            line: Result("", *result) for line, result in NEAR_NAMES.items()
        }
        with start("topic", "hz", "/tpic") as hz:
            assert hz.error_line().endswith("; did you mean '/topic'?")


def test_where_two_types_of_one_name_differ(daemon: object) -> None:
    ours = WHEEL.format(kind="float", name="ours", end="publisher")
    theirs = WHEEL.format(kind="str", name="theirs", end="subscription")
    text = "both call it demo/msg/Wheel, but field 'speed' is float64 at {} and string at {}"
    ends = "the publisher", "the subscription"
    with script(ours), script(theirs):
        result = bus("topic", "info", "-v", "/wheel")
        assert result.out.count(f"(no match: {text.format(*ends)})\n") == 2
        assert bus("topic", "echo", "/wheel") == Result(
            "",
            "Cannot echo topic '/wheel', as it contains more than one type: [demo/msg/Wheel]; "
            f"/ours and /theirs {text.format('/ours', '/theirs')}\n",
            1,
        )


def test_two_nodes_of_one_name_are_told_to_both(daemon: object) -> None:
    with script(LISTENER) as first, script(LISTENER) as second:
        for one, other in ((first, second), (second, first)):
            line = one.error_line()
            assert line.startswith("[WARN]")
            assert (
                f"there is another node named /minimal_subscriber, in pid {other.process.pid} (-c), " in line
            )
        assert first.end(signal.SIGINT).err == second.end(signal.SIGINT).err == ""


LISTS = ("topic list", "node list", "service list", "action list", "param list", "lifecycle nodes")


def _at_a_terminal(line: str) -> tuple[str, str]:
    """The output of a verb if only stderr is a terminal."""
    terminal, theirs = pty.openpty()
    out, into = os.pipe()
    with open(os.devnull) as nothing:  # noqa: PTH123
        verb = begin(("-m", "bus_cli", *line.split()), (nothing.fileno(), into, theirs))
    os.close(theirs)
    os.close(into)
    texts = []
    for end in (out, terminal):
        with open(end, "rb", 0) as shown, suppress(OSError):  # EIO is the end of a terminal  # noqa: PTH123
            texts.append("")
            while more := shown.read(4096):
                texts[-1] += more.decode()
    assert verb.wait(WAIT_S) == 0
    return texts[0], texts[1]


def test_lists_of_nothing_say_where_at_a_terminal(daemon: Daemon) -> None:
    said = f"no nodes on {daemon.path} (set by BUSD_SOCKET={daemon.path})\r\n"
    assert {line: _at_a_terminal(line) for line in LISTS} == dict.fromkeys(LISTS, ("", said))
    assert {line: bus(*line.split()) for line in LISTS} == dict.fromkeys(LISTS, Result("", "", 0))
    line = f"--socket {daemon.path} topic list"
    assert _at_a_terminal(line) == ("", f"no nodes on {daemon.path}\r\n")
    with script(LISTENER):
        assert _at_a_terminal("action list") == ("", "")
