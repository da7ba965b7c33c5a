"""Each verb of `bus` once in a fresh interpreter; other tests fork an interpreter that has imported it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_cli.main import COMMANDS, VERBS_WITH_VERBS
from cli import bus, script
from effort import is_nightly

pytestmark = pytest.mark.landing

WORLD = """
import asyncio, bus
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Trigger
from bus_actions import ActionServer, find_action
Fibonacci = find_action("example_interfaces/action/Fibonacci")
async def turn(goal):
    return Fibonacci.Result(sequence=[0, 1])
async def main():
    async with bus.Node("world") as node:
        await node.create_publisher(String, "topic", 10)
        await node.create_service(Trigger, "ask", lambda request: Trigger.Response(success=True))
        server = ActionServer(node, Fibonacci, "turn", turn)
        await server.open()
        await node.declare_parameter("speed", 42)
        await node.declare_parameter("extra", 1, dynamic_typing=True)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
TRIGGER = "std_srvs/srv/Trigger"
HELP = "--help"
LINES = {
    "action find": "example_interfaces/action/Fibonacci",
    "component list": "",
    "component load": "--help",
    "component standalone": "--help",
    "component types": "",
    "component unload": "--help",
    "doctor hello": "--help",
    "wtf hello": "--help",
    "multicast receive": "--help",
    "multicast send": "",
    "ros2 install": "--help",
    "ros2 uninstall": "--help",
    "service call": f"/ask {TRIGGER}",
    "service find": TRIGGER,
    "service info": "/ask",
    "service list": "",
    "service type": "/ask",
    "param delete": "/world extra",
    "param describe": "/world speed",
    "param dump": "/world",
    "param get": "/world speed",
    "param list": "",
    "param load": "/world FOLDER/world.yaml",
    "param set": "/world speed 43",
    "action info": "/turn",
    "action list": "",
    "action send_goal": "/turn example_interfaces/action/Fibonacci {}",
    "action type": "/turn",
    "bag burst": "--help",
    "lifecycle get": "--help",
    "lifecycle list": "--help",
    "lifecycle nodes": "--help",
    "lifecycle set": "--help",
    "tf2 echo": "--help",
    "tf2 frames": "--help",
    "tf2 monitor": "--help",
    "interface c": "std_msgs/msg/String",
    "interface cpp": "std_msgs/msg/String",
    "interface list": "",
    "interface package": "std_msgs",
    "interface packages": "",
    "interface proto": "std_msgs/msg/String",
    "interface show": "std_msgs/msg/String",
    "bag convert": "--help",
    "bag info": "--help",
    "bag list": "storage",
    "bag reindex": "--help",
    "bridge ros2": "--help",
    "bridge status": "--help",
    "bridge zenoh": "--help",
    "daemon install": "--dry-run",
    "daemon peers": "",
    "daemon restart": "",
    "daemon start": "",
    "daemon stop": "",
    "daemon uninstall": "--help",
    "bench fanout": "--help",
    "bench latency": "--help",
    "bench throughput": "--help",
    "pkg create": "demo --build-type ament_python --destination-directory FOLDER",
    "pkg executables": "",
    "pkg list": "--help",
    "pkg prefix": "--help",
    "pkg xml": "--help",
    "top": "--once -d 0.1",
    "doctor": "",
    "wtf": "",
    "completion": "bash",
}
"""Arguments for each command; the tests run in this order."""
ELSEWHERE = {
    *(f"topic {verb}" for verb in COMMANDS["topic"][1]),
    *(
        "node info",
        "node list",
        "service echo",
        "daemon status",
        "metrics",
        "web",
        "run",
        "launch",
        "test",
        "bag record",
        "bag play",
    ),
}
"""Verbs that other tests start as processes: `tests/system/test_cli_{tool,metrics,run}.py`, `test_web.py`,
`test_launch*.py`, `test_bag_*.py`."""


@pytest.fixture
def world(daemon: object) -> Iterator[None]:
    with script(WORLD):
        yield


def verbs_of(command: str) -> list[str]:
    return [line for line in LINES if line.partition(" ")[0] == command]


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(
            one, marks=pytest.mark.nightly if {LINES[verb] for verb in verbs_of(one)} == {HELP} else ()
        )
        for one in sorted({line.partition(" ")[0] for line in LINES})
    ],
)
def test_all_verbs(world: None, tmp_path: Path, command: str) -> None:
    (tmp_path / "world.yaml").write_text("/world: {ros__parameters: {speed: 44}}\n")
    for line in verbs_of(command):
        if LINES[line] == HELP and not is_nightly():
            continue  # tests/unit/bus_cli/test_main.py imports it and has its help
        words = f"{line} {LINES[line]}".replace("FOLDER", str(tmp_path)).split()
        result = bus(*words, is_fresh=True)
        assert (result.code, result.err) == (0, ""), words
        assert result.out or line in ("pkg executables", "component list", "component types"), words


def test_an_error(world: None) -> None:
    why = "busd was started without --config, so there is nothing to reload\n"
    assert bus("daemon", "reload", is_fresh=True) == ("", why, 1)


def test_none_is_missing() -> None:
    verbs = {
        f"{command} {verb}".strip() for command, (_, verbs) in COMMANDS.items() for verb in verbs or [""]
    }
    verbs.update(VERBS_WITH_VERBS)
    assert verbs == LINES.keys() | ELSEWHERE | {"daemon reload"}
