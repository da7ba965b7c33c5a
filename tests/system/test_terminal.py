"""On a real terminal: control characters in names and messages of other programs never reach it."""

import json
import os
import pty
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from bus.base.printable import printable
from cli import BUS, begin, bus, script, start
from conftest import WAIT_S
from neighbours import wait_until

HOSTILE = "\x1b]0;PWNED\x07\x1b[31mred\x9b2J\u202elive\u2028[FATAL] [0.0] [you]: forged\rover\nand\tout\x7f"

EVIL = f"""
import asyncio, sys, bus, msgspec
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Trigger
HOSTILE = {HOSTILE!r}
sys.argv[0] = HOSTILE
class Own(msgspec.Struct):
    names: list[str]
    table: dict[str, str]
def answer(request):
    return Trigger.Response(success=True, message=HOSTILE)
async def main():
    kept = bus.QoSProfile(1, durability="transient_local")
    async with bus.Node("evil") as node:
        for kind, topic, message in (
            (String, "s", String(data=HOSTILE)), (Own, "own", Own([HOSTILE], {{HOSTILE: HOSTILE}}))
        ):
            (await node.create_publisher(kind, topic, kept)).publish(message)
        await node.create_service(Trigger, "answer", answer)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
FAILING = f"""
import asyncio, bus
from bus.srv.std_srvs import Trigger
def fail(request):
    raise ValueError({HOSTILE!r})
async def main():
    async with bus.Node("failing") as node:
        await node.create_service(Trigger, "fail", fail)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
"""The program ends with the first call."""
PARAMETERS = f"""
import bus_ros.rclpy as rclpy
from bus_ros.rosidl import message_class
HOSTILE = {HOSTILE!r}
Descriptor = message_class("rcl_interfaces/msg/ParameterDescriptor")
rclpy.init()
node = rclpy.create_node("params")
for name in ("text", HOSTILE):
    node.declare_parameter(name, HOSTILE, Descriptor(description=HOSTILE, additional_constraints=HOSTILE))
node.add_on_set_parameters_callback(
    lambda changes: message_class("rcl_interfaces/msg/SetParametersResult")(successful=False, reason=HOSTILE))
print("ready", flush=True)
rclpy.spin(node)
"""
LISTENER = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    heard = asyncio.Event()
    async with bus.Node("listener") as node:
        def hear(message):
            node.get_logger().info(f"\\x1b[1mI heard\\x1b[0m: {message.data}")
            heard.set()
        await node.create_subscription(String, "s", bus.QoSProfile(1, durability="transient_local"), hear)
        await heard.wait()
bus.run(main())
"""
CALLER = """
import bus
from bus.srv.std_srvs import Trigger
async def main():
    async with bus.Node("caller") as node:
        client = await node.create_client(Trigger, "fail")
        await client.wait_for_service()
        await client.call(Trigger.Request())
bus.run(main())
"""


def on_a_terminal(*words: str) -> str:
    """The output of a Python program until it ends, stdout and stderr together."""
    ours, theirs = pty.openpty()
    said, end = b"", time.monotonic() + WAIT_S
    with Path(os.devnull).open("rb") as nothing:
        process = begin(words, (nothing.fileno(), theirs, theirs))
    os.close(theirs)
    while time.monotonic() < end and select.select([ours], [], [], WAIT_S)[0]:
        try:
            said += os.read(ours, 1 << 16)
        except OSError:  # the other end is closed
            break
    else:
        process.kill()
    process.wait(WAIT_S)
    os.close(ours)
    return said.decode().replace("\r\n", "\n")


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A bus with programs that use hostile names and texts; for all tests of this file."""
    path = tmp_path_factory.mktemp("terminal") / "busd.sock"
    with pytest.MonkeyPatch.context() as patch, ExitStack() as running:
        patch.setenv("BUSD_SOCKET", str(path))
        patch.setenv("BUSD_AUTOSTART", "0")
        command = [sys.executable, "-m", "busd", "--socket", str(path)]
        busd = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        running.callback(busd.wait)
        running.callback(busd.terminate)
        wait_until(lambda: bus("daemon", "status").code == 0)
        running.enter_context(script(EVIL))
        running.enter_context(script(PARAMETERS))
        wait_until(lambda: "/params/get_parameters" in bus("service", "list").out)
        yield


@pytest.mark.usefixtures("evil")
@pytest.mark.parametrize(
    ("line", "is_there"),
    [
        ("topic echo --once /s", True),
        ("topic echo --once /s --field data", True),
        ("topic echo --once /s --csv", True),
        ("topic echo --once /s --json", True),
        ("topic echo --once /s --flow-style -i", True),
        ("topic echo --once /s --raw", True),
        ("topic echo --once /own", True),
        ("topic echo --once /own --field names --field table", True),
        ("topic echo --once /own --field names[0]", True),
        ("topic echo --once /own --csv", True),
        ("topic echo --once /own --json", True),
        ("topic info -v /s", False),
        ("topic list -v", False),
        ("node list -a", False),
        ("node info /evil", False),
        ("service call /answer std_srvs/srv/Trigger", True),
        ("service call /answer std_srvs/srv/Trigger --json", True),
        ("param list", True),
        ("param list /params --json", True),
        ("param get /params text", True),
        ("param get /params text --hide-type", True),
        ("param describe /params text", True),
        ("param dump /params", True),
        ("param set /params text x", True),
        ("daemon peers", True),
        ("doctor", False),
    ],
)
def test_a_verb(line: str, is_there: bool) -> None:
    shown = on_a_terminal(*BUS[1:], *line.split())
    assert printable(shown) == shown
    assert shown
    assert ("PWNED" in shown) is is_there


@pytest.mark.usefixtures("evil")
def test_a_program_that_logs_what_it_heard() -> None:
    """It keeps its own colours; they end with the line."""
    shown = on_a_terminal("-c", LISTENER)
    (first, second) = shown.splitlines()
    assert first.endswith(
        r"[listener]: "
        "\x1b[1mI heard\x1b[0m: "
        r"\x1b]0;PWNED\x07"
        "\x1b[31mred"
        r"\x9b2J\u202elive\u2028"
        r"[FATAL] [0.0] [you]: forged\rover"
    )
    assert second == "and\tout\\x7f\x1b[0m"


_CALL = (*BUS[1:], "service", "call", "/fail", "std_srvs/srv/Trigger")


@pytest.mark.usefixtures("evil")
@pytest.mark.parametrize("words", [("-c", CALLER), _CALL], ids=["a traceback", "a verb"])
def test_why_a_service_failed(words: tuple[str, ...]) -> None:
    with script(FAILING):
        shown = on_a_terminal(*words)
    assert "service '/fail' failed: ValueError: \\x1b]0;PWNED" in shown
    assert printable(shown) == shown


@pytest.mark.usefixtures("evil")
class TestData:
    """Output for programs is complete."""

    def test_yaml(self) -> None:
        (text, _) = bus("topic", "echo", "--once", "-f", "/own").out.split("---\n")
        assert yaml.safe_load(text) == {"names": [HOSTILE], "table": {HOSTILE: HOSTILE}}

    def test_json(self) -> None:
        told = json.loads(bus("topic", "echo", "--once", "/own", "--json").out)
        assert told == {"names": [HOSTILE], "table": {HOSTILE: HOSTILE}}

    def test_csv_is_one_line_for_a_message(self) -> None:
        (line,) = bus("topic", "echo", "--once", "-f", "/own", "--csv").out.split("\n")[:-1]
        assert line == ",".join([printable(HOSTILE, keep="\t")] * 2)

    def test_echo_into_pub(self) -> None:
        text = bus("topic", "echo", "--once", "-f", "/s").out
        with start("topic", "echo", "--once", "/copy", "std_msgs/String", "--json") as echo:
            assert bus("topic", "pub", "-w", "1", "/copy", "std_msgs/String", "--stdin", stdin=text).code == 0
            assert json.loads(echo.line()) == {"data": HOSTILE}

    def test_a_file_of_parameters(self) -> None:
        told = yaml.safe_load(bus("param", "dump", "/params").out)
        assert told["/params"]["ros__parameters"]["text"] == HOSTILE
