"""The verbs of `bus param`, against the texts of the real `ros2`."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bus.parameters.file import read_file
from cli import TALKER, Result, Running, bus, script, start, wait_for_graph

# A node with parameters; its first argument is its name. It serves them itself, so this test does not need
# the facade's engine.
ROBOT = """
import asyncio, sys, bus
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.parameter_service import ParameterService
from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rosidl import message_class

Descriptor = message_class("rcl_interfaces/msg/ParameterDescriptor")
IntegerRange = message_class("rcl_interfaces/msg/IntegerRange")

class Host:
    def __init__(self, parameters):
        self.parameters, self.services = parameters, []
    def get_name(self):
        return sys.argv[1]
    def create_service(self, kind, name, callback, **options):
        self.services.append((kind, name, callback))
    def __getattr__(self, name):
        return getattr(self.parameters, name)

async def main():
    parameters = NodeParameters()
    parameters.declare_parameters("", [
        ("use_sim_time", False),
        ("speed", 42, Descriptor(description="how fast", integer_range=[
            IntegerRange(from_value=0, to_value=100, step=2)])),
        ("ratio", 1.5),
        ("arm.name", "left"),
        ("arm.lengths", [1.0, 2.5]),
        ("arm.flags", [True, False]),
        ("ids", [1, 2]),
        ("names", ["a", "b"]),
        ("octets", [b"\\x01"]),
        ("serial", "1e5", Descriptor(read_only=True)),
        ("extra", 1, Descriptor(dynamic_typing=True)),
        ("empty", Parameter.Type.STRING),
    ])
    host = Host(parameters)
    ParameterService(host)
    async with bus.Node(sys.argv[1]) as node:
        for service in host.services:
            await node.create_service(*service)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""

# A node with such a service that can't answer.
BROKEN = """
import asyncio, bus
from bus_ros.rosidl import service_class
def fail(request):
    raise ValueError("no list today")
async def main():
    async with bus.Node("broken") as node:
        kind = service_class("rcl_interfaces/srv/ListParameters")
        await node.create_service(kind, "broken/list_parameters", fail)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""

NAMES = [
    "arm.flags",
    "arm.lengths",
    "arm.name",
    "empty",
    "extra",
    "ids",
    "names",
    "octets",
    "ratio",
    "serial",
    "speed",
    "use_sim_time",
]


@pytest.fixture
def robot(daemon: object) -> Iterator[Running]:
    with script(ROBOT, "robot") as running:
        yield running


def said(text: str) -> Result:
    return Result(f"{text}\n", "", 0)


def refused(text: str) -> Result:
    return Result("", f"{text}\n", 1)


def test_list(route: str, robot: Running) -> None:
    lines = "".join(f"  {name}\n" for name in NAMES)
    assert bus("param", "list", "/robot") == Result(lines, "", 0)
    assert bus("param", "list", "robot").out == lines
    with script(ROBOT, "other"), script(TALKER, "1000"):
        assert bus("param", "list") == Result(f"/other:\n{lines}/robot:\n{lines}", "", 0)


def test_list_a_part(robot: Running) -> None:
    assert bus("param", "list", "robot", "--filter", "arm|.*s$").out == (
        "  arm.flags\n  arm.lengths\n  arm.name\n  ids\n  names\n  octets\n"
    )
    # As in ROS 2, the beginning of a name must match, and a node without a match has no line.
    assert bus("param", "list", "--filter", "name") == said("/robot:\n  names")
    assert bus("param", "list", "--filter", "nosuch") == Result("", "", 0)
    assert bus("param", "list", "robot", "--param-prefixes", "arm").out == (
        "  arm.flags\n  arm.lengths\n  arm.name\n"
    )
    assert bus("param", "list", "--param-type", "robot").out == (
        "  arm.flags (type: boolean array)\n"
        "  arm.lengths (type: double array)\n"
        "  arm.name (type: string)\n"
        "  empty (type: not set)\n"
        "  extra (type: integer)\n"
        "  ids (type: integer array)\n"
        "  names (type: string array)\n"
        "  octets (type: byte array)\n"
        "  ratio (type: double)\n"
        "  serial (type: string)\n"
        "  speed (type: integer)\n"
        "  use_sim_time (type: boolean)\n"
    )
    broken = bus("param", "list", "--filter", "[")
    assert broken.code == 2
    assert "'[' is not a regular expression: unterminated character set" in broken.err


GET = {
    "use_sim_time": "Boolean value is: False",
    "speed": "Integer value is: 42",
    "ratio": "Double value is: 1.5",
    "serial": "String value is: 1e5",
    "octets": r"Byte values are: [b'\x01']",
    "arm.flags": "Boolean values are: [True, False]",
    "ids": "Integer values are: array('q', [1, 2])",
    "arm.lengths": "Double values are: array('d', [1.0, 2.5])",
    "names": "String values are: ['a', 'b']",
    "empty": "Parameter not set.",
    "nosuch": "Parameter not set.",
}


def test_get(robot: Running) -> None:
    assert {name: bus("param", "get", "robot", name) for name in GET} == {
        name: said(text) for name, text in GET.items()
    }
    assert bus("param", "get", "--hide-type", "robot", "ids") == said("array('q', [1, 2])")
    assert bus("param", "get", "/robot", "speed", "--hide-type") == said("42")


def test_set(route: str, robot: Running) -> None:
    assert bus("param", "set", "robot", "speed", "44") == said("Set parameter successful")
    assert bus("param", "get", "robot", "speed") == said("Integer value is: 44")
    assert bus("param", "set", "robot", "arm.name", "y") == said("Set parameter successful")
    assert bus("param", "set", "robot", "ids", "[7]") == said("Set parameter successful")
    assert bus("param", "get", "robot", "ids", "--hide-type") == said("array('q', [7])")
    assert bus("param", "set", "robot", "extra", "-1.5") == said("Set parameter successful")
    assert bus("param", "get", "robot", "extra") == said("Double value is: -1.5")


FAILING = {
    ("speed", "45"): "The parameter value for speed is not a valid step. "
    "Min: 0, max: 100, value: 45, step: 2",
    ("speed", "-4"): "Parameter speed out of range. Min: 0, Max: 100, value: -4",
    ("speed", "fast"): "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'",
    ("serial", "x"): "Trying to set a read-only parameter: serial.",
    ("nosuch", "1"): "Invalid access to undeclared parameter(s): ['nosuch']",
}


def test_set_what_is_refused(robot: Running) -> None:
    for words, reason in FAILING.items():
        assert bus("param", "set", "robot", *words) == refused(f"Setting parameter failed: {reason}")
    assert bus("param", "get", "robot", "speed") == said("Integer value is: 42")


def test_delete(robot: Running) -> None:
    assert bus("param", "delete", "robot", "extra") == said("Deleted parameter successfully")
    assert "extra" not in bus("param", "list", "robot").out
    assert bus("param", "delete", "robot", "speed") == refused(
        "Deleting parameter failed: Static parameter cannot be undeclared"
    )


def test_describe(robot: Running) -> None:
    assert bus("param", "describe", "robot", "speed", "serial", "nosuch").out == (
        "Parameter name: speed\n"
        "  Type: integer\n"
        "  Description: how fast\n"
        "  Constraints:\n"
        "    Min value: 0\n"
        "    Max value: 100\n"
        "    Step: 2\n"
        "Parameter name: serial\n"
        "  Type: string\n"
        "  Constraints:\n"
        "    Read only: true\n"
        "Parameter name: nosuch\n"
        "  Type: not set\n"
        "  Constraints:\n"
    )


DUMP = """\
/robot:
  ros__parameters:
    arm:
      flags:
      - true
      - false
      lengths:
      - 1.0
      - 2.5
      name: left
    extra: 1
    ids:
    - 1
    - 2
    names:
    - a
    - b
    octets:
    - 1
    ratio: 1.5
    serial: '1e5'
    speed: 42
    use_sim_time: false

"""


def test_the_nearest_parameter(robot: Running) -> None:
    none = "Node '/robot' has no parameter 'sped'; did you mean 'speed'?\n"
    assert bus("param", "get", "robot", "sped") == Result("Parameter not set.\n", none, 0)
    described = bus("param", "describe", "robot", "sped", "speed")
    assert described.err.count(none) == 1
    for words in (("set", "robot", "sped", "3"), ("delete", "robot", "sped")):
        result = bus("param", *words)
        assert result.err.endswith("; did you mean 'speed'?\n")
        assert result.code == 1


def test_dump_and_load(robot: Running, tmp_path: Path) -> None:
    assert bus("param", "dump", "robot") == Result(DUMP, "", 0)
    path = tmp_path / "robot.yaml"
    path.write_text(DUMP.replace("42", "50").replace("    octets:\n    - 1\n", ""))
    assert read_file(path)[0].parameters["serial"] == "1e5"
    loaded = bus("param", "load", "robot", str(path))
    assert "Set parameter arm.flags successful\n" in loaded.out
    assert loaded.err == ("Set parameter serial failed: Trying to set a read-only parameter: serial.\n")
    assert loaded.code == 1
    assert bus("param", "get", "robot", "speed") == said("Integer value is: 50")


def test_load(robot: Running, tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text("/**: {ros__parameters: {ratio: 2.5}}\n/robot: {ros__parameters: {arm: {name: right}}}\n")
    assert bus("param", "load", "robot", str(path)) == said(
        "Set parameter ratio successful\nSet parameter arm.name successful"
    )
    assert bus("param", "load", "robot", str(path), "--no-use-wildcard") == said(
        "Set parameter arm.name successful"
    )
    assert bus("param", "get", "robot", "arm.name") == said("String value is: right")
    path.write_text("/other: {ros__parameters: {ratio: 2.5}}\n")
    assert bus("param", "load", "robot", str(path)) == refused(
        "Param file does not contain parameters for /robot, only for nodes: ['/other']"
    )
    path.write_text("/robot: 1\n")
    assert bus("param", "load", "robot", str(path)).err.startswith(f"{path}:1: '/robot' has a value")
    nosuch = tmp_path / "nosuch"
    assert bus("param", "load", "robot", str(nosuch)) == refused(
        f"cannot read '{nosuch}': No such file or directory"
    )


def test_json(robot: Running) -> None:
    def read(*words: str) -> object:
        return msgspec.json.decode(bus("param", *words, "--json").out)

    assert read("list", "--filter", "name") == {
        "node": "/robot",
        "parameters": [{"name": "names"}],
    }
    assert read("get", "robot", "ids") == {
        "node": "/robot",
        "parameter": "ids",
        "type": "integer array",
        "value": [1, 2],
    }
    assert read("get", "robot", "octets") == {
        "node": "/robot",
        "parameter": "octets",
        "type": "byte array",
        "value": [1],
    }
    assert read("set", "robot", "speed", "2") == {"successful": True, "reason": ""}
    assert read("delete", "robot", "extra") == {"successful": True, "reason": ""}
    described = read("describe", "robot", "speed")
    assert isinstance(described, dict)
    assert (described["type"], described["integer_range"][0]["step"]) == ("integer", 2)
    dumped = read("dump", "robot")
    assert isinstance(dumped, dict)
    assert dumped["parameters"]["arm.lengths"] == [1.0, 2.5]


@pytest.mark.parametrize(
    "words",
    ["list x", "get x a", "set x a 1", "dump x", "load x f.yaml", "describe x a", "delete x a"],
)
def test_no_such_node(daemon: object, words: str) -> None:
    in_no_time = [] if words.startswith("list") else ["--timeout", "0"]
    assert bus("param", *words.split(), *in_no_time) == refused("Node not found")


def test_a_node_that_appears_in_time(daemon: object) -> None:
    with start("param", "get", "robot", "speed", "--timeout", "-1") as getting:
        wait_for_graph(lambda graph: True)
        with script(ROBOT, "robot"):
            assert getting.line() == "Integer value is: 42"
            assert getting.end().code == 0


def test_hidden_nodes(daemon: object) -> None:
    with script(ROBOT, "_robot"):
        for words in ("list _robot", "get _robot speed", "set _robot speed 2"):
            assert bus("param", *words.split()) == refused(
                "Node not found; --include-hidden-nodes finds hidden ones, too"
            )
        assert bus("param", "list") == Result("", "", 0)
        for words, text in {
            "get _robot speed": "Integer value is: 42",
            "set _robot speed 2": "Set parameter successful",
            "delete _robot extra": "Deleted parameter successfully",
        }.items():
            assert bus("param", *words.split(), "--include-hidden-nodes") == said(text)
        assert bus("param", "dump", "_robot", "--include-hidden-nodes").out.startswith("/_robot:\n")
        assert bus("param", "list", "--include-hidden-nodes").out.startswith("/_robot:\n  arm.flags\n")


def test_nothing_is_there(daemon: object) -> None:
    assert bus("param", "list") == Result("", "", 0)


def test_a_node_without_parameter_services(daemon: object) -> None:
    with script(TALKER, "1000"):
        assert bus("param", "get", "minimal_publisher", "x") == refused(
            "node '/minimal_publisher' has no parameters (no service '/minimal_publisher/get_parameters')"
        )
        assert bus("param", "list") == Result("", "", 0)


def test_a_node_that_fails(daemon: object) -> None:
    why = "service '/broken/list_parameters' failed: ValueError: no list today\n"
    with script(BROKEN):
        assert bus("param", "list", "broken") == Result("", why, 1)
    with script(BROKEN), script(ROBOT, "robot"):
        listed = bus("param", "list")
    assert listed.err == f"Exception while calling service of node '/broken': {why}"
    assert listed.out.startswith("/robot:\n  arm.flags\n")
    assert listed.code == 0
