"""`bus component` with a container of Python components, against the texts of the real `ros2`."""

import signal
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from bus_cli.component.remote import _complete_containers
from bus_cli.main import make_parser
from cli import Result, Running, bus, script, wait_for_graph

MODULE = """\
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self, **kwargs):
        super().__init__("talker", **kwargs)
        self.declare_parameter("text", "hi")
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.timer = self.create_timer(0.05, self.tick)

    def tick(self):
        self.publisher.publish(String(data=self.get_parameter("text").value))

class Plain(Node):
    def __init__(self):
        super().__init__("plain")

class Broken(Node):
    def __init__(self):
        raise ValueError("no camera")

class BreaksLate(Node):
    def __init__(self):
        super().__init__("breaks_late")
        Node("part_of_it")
        raise ValueError("no lens")
        self.lens = 1

    def destroy_node(self):
        self.lens
        super().destroy_node()
"""
# Components that are unloaded in the middle of a callback.
MIDWAY = """
import time
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String

class Waits(Node):
    def __init__(self):
        super().__init__("waits")
        self.publisher = self.create_publisher(String, "midway", 10)
        self.timer = self.create_timer(0.01, self.tick)
        self.is_gone = Future()

    def begin(self):
        self.timer.cancel()
        self.publisher.publish(String(data="in the callback"))

    def tick(self):
        self.begin()
        while not self.is_gone.done():
            time.sleep(0.001)
        self.publisher.publish(String(data="never"))

    def destroy_node(self):
        super().destroy_node()
        self.is_gone.set_result(None)

class Awaits(Waits):
    async def tick(self):
        self.begin()
        await self.is_gone
        self.publisher.publish(String(data="never"))
"""
# Another thread makes a node while a constructor runs that will fail.
AT_ONCE = """
from threading import Event, Thread
from rclpy.node import Node

wanted, made = Event(), Event()
nodes = []

def make():
    wanted.wait()
    nodes.append(Node("bystander"))
    made.set()

Thread(target=make, daemon=True).start()

class Fails(Node):
    def __init__(self):
        super().__init__("fails")
        wanted.set()
        made.wait()
        raise ValueError("no lens")
"""
# A node with the services of a container that never answers.
SILENT = """
import asyncio, bus
from bus.types.classes import service_class
async def wait(request):
    await asyncio.Event().wait()
async def main():
    async with bus.Node("silent") as node:
        for verb, what in ("load", "Node"), ("unload", "Node"), ("list", "Nodes"):
            service = service_class(f"composition_interfaces/srv/{verb.title()}{what}")
            await node.create_service(service, f"silent/_container/{verb}_{what.lower()}", wait)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""
CONTAINER = "/ComponentManager"


def run_container(folder: Path, *words: str) -> Running:
    return Running(("-m", "bus_cli", "run", "--force", *words), folder=folder)


@pytest.fixture(params=["component_container", "component_container_mt"])
def container(daemon: object, tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Running]:
    (tmp_path / "parts.py").write_text(MODULE)
    with run_container(tmp_path, "rclpy_components", request.param) as running:
        wait_for_graph(lambda graph: graph.servers_of(f"{CONTAINER}/_container/list_nodes"))
        yield running


def loaded(number: int, name: str) -> Result:
    text = f"Loaded component {number} into '{CONTAINER}' container node as '{name}'\n"
    return Result(text, "", 0)


def test_load_list_and_unload(container: Running) -> None:
    assert bus("component", "list") == Result(f"{CONTAINER}\n", "", 0)
    load = ("component", "load", CONTAINER, "parts", "parts:Talker")
    assert bus(*load) == loaded(1, "/talker")
    rules = ("-r", "chatter:=/out", "-p", "text:=yo", "-n", "second", "--node-namespace", "/a")
    assert bus(*load, *rules, "--log-level", "warn") == loaded(2, "/a/second")
    assert bus("component", "load", "-q", "ComponentManager", "parts", "parts:Plain").out == "3  /plain\n"
    names = ("1  /talker", "2  /a/second", "3  /plain")
    assert bus("component", "list", CONTAINER).out == "".join(f"{name}\n" for name in names)
    assert bus("component", "list").out == f"{CONTAINER}\n" + "".join(f"  {name}\n" for name in names)
    assert bus("component", "list", "--containers-only").out == f"{CONTAINER}\n"
    assert bus("topic", "echo", "--once", "/out", "--field", "data").out == "yo\n---\n"
    assert bus("topic", "echo", "--once", "/chatter", "--field", "data").out == "hi\n---\n"
    unload = ("component", "unload", CONTAINER)
    assert bus(*unload, "1") == Result(f"Unloaded component 1 from '{CONTAINER}' container node\n", "", 0)
    wait_for_graph(lambda graph: not graph.publishers_of("/chatter"))
    assert bus(*unload, "-q", "2", "7", "3") == Result(
        "2\n",
        f"Failed to unload component 7 from '{CONTAINER}' container node\n"
        "    No node found with unique_id: 7\n",
        1,
    )
    assert bus("node", "list").out == f"{CONTAINER}\n/plain\n"
    assert container.end(signal.SIGINT).code == 0


def test_json(container: Running) -> None:
    assert bus("component", "load", CONTAINER, "parts", "parts:Plain", "--json").out == (
        f'{{"container":"{CONTAINER}","id":1,"node":"/plain"}}\n'
    )
    record = msgspec.json.decode(bus("component", "list", "--json").out)
    assert record == {"container": CONTAINER, "components": [{"id": 1, "node": "/plain"}]}
    assert bus("component", "unload", CONTAINER, "1", "--json").out == (
        f'{{"container":"{CONTAINER}","id":1}}\n'
    )


def test_what_can_not_be_loaded(container: Running) -> None:
    failed = "Failed to load component: "
    for words, text in {
        "parts parts:Broken": "ValueError: no camera",
        "parts parts:BreaksLate": "ValueError: no lens",
        "parts parts:Talker --log-level 35": "35 is no severity (UNSET 0, DEBUG 10, INFO 20, WARN 30, ",
        "parts parts:Nosuch": "Module 'parts' has no class 'Nosuch'",
        "parts parts:Talker -n 1x": "RCLInvalidROSArgsError: Failed to parse ROS arguments: ",
        "x nosuch:X": "ModuleNotFoundError: No module named 'nosuch'",
        "parts parts:Plain -n other": "Plain can't get a name, rules or parameters: its __init__ has no ",
        "demo_nodes_cpp demo_nodes_cpp::Talker": (
            "Package 'demo_nodes_cpp' has no component 'demo_nodes_cpp::Talker' in Python; components in C++ "
            "can't be loaded here"
        ),
    }.items():
        result = bus("component", "load", CONTAINER, *words.split())
        assert (result.out, result.code) == ("", 1), words
        assert result.err.startswith(f"{failed}{text}"), words
    assert bus("component", "list", CONTAINER) == Result("", "", 0)
    assert bus("node", "list").out == f"{CONTAINER}\n"
    for words in ("-p text", "--log-level loud", "--log-level 256"):
        assert bus("component", "load", CONTAINER, "parts", "parts:Talker", *words.split()).code == 2


def test_a_failed_load_leaves_nodes_of_other_threads(container: Running, tmp_path: Path) -> None:
    (tmp_path / "at_once.py").write_text(AT_ONCE)
    result = bus("component", "load", CONTAINER, "at_once", "at_once:Fails")
    assert result.err.startswith("Failed to load component: ValueError: no lens")
    assert bus("node", "list").out == f"{CONTAINER}\n/bystander\n"


@pytest.mark.parametrize("name", ["Waits", "Awaits"])
def test_a_component_unloaded_in_the_middle_of_a_callback(
    container: Running, tmp_path: Path, request: pytest.FixtureRequest, name: str
) -> None:
    if name == "Waits" and "component_container_mt" not in request.node.name:
        pytest.skip("with one thread, the container can't answer during a callback")
    (tmp_path / "midway.py").write_text(MIDWAY)
    with Running(("-m", "bus_cli", "topic", "echo", "/midway", "std_msgs/msg/String")) as echo:
        wait_for_graph(lambda graph: graph.subscriptions_of("/midway"))
        assert bus("component", "load", CONTAINER, "midway", f"midway:{name}") == loaded(1, "/waits")
        assert echo.lines(2) == "data: in the callback\n---\n"
        assert bus("component", "unload", CONTAINER, "1", "-q") == Result("1\n", "", 0)
        container.error_line_with(
            r"\[waits\]: a callback was not finished before the unloading: the publisher on '/midway' is"
        )
        assert bus("component", "load", CONTAINER, "parts", "parts:Plain") == loaded(2, "/plain")
        assert echo.end(signal.SIGINT).out == ""
    assert container.end(signal.SIGINT).code == 0


def test_no_container(daemon: object) -> None:
    assert bus("component", "list") == Result("", "", 0)
    unable = "Unable to find container node "
    assert bus("component", "list", "/x") == Result("", f"{unable}'/x'\n", 1)
    with script(SILENT):
        near = f"{unable}'silnt'; did you mean '/silent'?\n"
        assert bus("component", "unload", "silnt", "1") == Result("", near, 1)
        args = make_parser(["component", "list"]).parse_args(["component", "list"])
        assert _complete_containers("", args) == ["/silent"]


def test_a_container_that_does_not_answer(daemon: object, monkeypatch: pytest.MonkeyPatch) -> None:
    with script(SILENT):
        assert bus("component", "list") == Result(
            "/silent\nNo 'list_nodes' service response when listing components\n", "", 0
        )
        assert bus("component", "list", "silent") == Result(
            "", "No 'list_nodes' service response when listing components in /silent\n", 1
        )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_standalone(daemon: object, tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "parts.py").write_text(MODULE)
    words = ("parts", "parts:Talker", "-c", "alone", "-n", "mine")
    with Running(("-m", "bus_cli", "component", "standalone", *words), folder=tmp_path) as running:
        wait_for_graph(lambda graph: graph.publishers_of("/chatter"))
        assert bus("component", "list").out == "/alone\n  1  /mine\n"
        assert running.end(number).code == -number
    assert bus("node", "list").out == ""


def test_standalone_that_fails(daemon: object, tmp_path: Path) -> None:
    (tmp_path / "parts.py").write_text(MODULE)
    words = ("parts", "parts:Broken", "-c", "alone")
    with Running(("-m", "bus_cli", "component", "standalone", *words), folder=tmp_path) as running:
        assert running.error_line_with("interrupting") == (
            "Failed to load component: ValueError: no camera, interrupting container node"
        )
        assert running.end().code == 1
    assert bus("node", "list").out == ""


def test_types(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package, entry in ("my_arm", "my_arm::Talker = arm:T"), ("other", "other::L = o:L"):
        metadata = tmp_path / f"{package}-1.0.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Name: {package}\nVersion: 1.0\n")
        (metadata / "entry_points.txt").write_text(f"[rclpy_components]\n{entry}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    assert bus("component", "types", is_fresh=True).out == "my_arm\n  my_arm::Talker\nother\n  other::L\n"
    assert bus("component", "types", "other", is_fresh=True) == Result("other::L\n", "", 0)
    assert bus("component", "types", "turtlesim", is_fresh=True) == Result("", "", 0)
    wrong = bus("component", "types", "turtlesm", is_fresh=True)
    assert wrong == Result("", "Unable to find package 'turtlesm'; did you mean 'turtlesim'?\n", 1)
