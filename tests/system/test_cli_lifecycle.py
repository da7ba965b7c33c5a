"""`bus lifecycle`, against the texts of the real `ros2`."""

import re
from collections.abc import Iterator

import pytest

from bus_cli.lifecycle.remote import _complete_nodes, transitions
from bus_cli.main import make_parser
from cli import Result, bus, script, words

NODES = """
import bus.rclpy_compat
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node

class Talker(LifecycleNode):
    def on_activate(self, state):
        return TransitionCallbackReturn.FAILURE

    def on_deactivate(self, state):
        return None

rclpy.init()
executor = SingleThreadedExecutor()
nodes = Talker("lc_talker"), Talker("_hidden"), LifecycleNode("lc", namespace="ns"), Node("plain")
for node in nodes:
    executor.add_node(node)
print("ready", flush=True)
executor.spin()
"""
BROKEN = """
import bus.rclpy_compat
import rclpy
from rclpy.lifecycle import Node

class Talker(Node):
    def on_configure(self, state):
        pass

rclpy.init()
node = Talker("lc_talker")
print("ready", flush=True)
rclpy.spin(node)
"""
FROM_UNCONFIGURED = (
    "- configure [1]\n\tStart: unconfigured\n\tGoal: configuring\n"
    "- shutdown [5]\n\tStart: unconfigured\n\tGoal: shuttingdown\n"
)
GOLDEN = {
    "lifecycle nodes": "/lc_talker\n/ns/lc\n",
    "lifecycle nodes -a": "/_hidden\n/lc_talker\n/ns/lc\n",
    "lifecycle nodes -c": "2\n",
    "lifecycle nodes --all --count-nodes --json": '{"count":3}\n',
    "lifecycle nodes --json": '{"node":"/lc_talker"}\n{"node":"/ns/lc"}\n',
    "lifecycle get": "/lc_talker: unconfigured [1]\n/ns/lc: unconfigured [1]\n",
    "lifecycle get lc_talker": "unconfigured [1]\n",
    "lifecycle get _hidden --include-hidden-nodes": "unconfigured [1]\n",
    "lifecycle get /ns/lc --json": '{"node":"/ns/lc","state":"unconfigured","id":1}\n',
    "lifecycle list lc_talker": FROM_UNCONFIGURED,
    "lifecycle list lc_talker --json": (
        '{"id":1,"transition":"configure","start":"unconfigured","goal":"configuring"}\n'
        '{"id":5,"transition":"shutdown","start":"unconfigured","goal":"shuttingdown"}\n'
    ),
}
UNKNOWN = "Unknown transition requested, available ones are:"
REFUSED = {
    "lifecycle get nobody": "Node not found\n",
    "lifecycle list lc_talkr": "Node not found; did you mean '/lc_talker'?\n",
    "lifecycle set _hidden configure": "Node not found; --include-hidden-nodes finds hidden ones, too\n",
    "lifecycle set plain configure": "Node not found: '/plain' exists, but is not a lifecycle node\n",
    "lifecycle set /lc_talker noop": f"{UNKNOWN}\n- configure [1]\n- shutdown [5]\n",
    "lifecycle set /lc_talker 3": f"{UNKNOWN}\n- configure [1]\n- shutdown [5]\n",
}


@pytest.fixture
def nodes(daemon: object) -> Iterator[None]:
    with script(NODES):
        yield


def test_what_is_there(nodes: None) -> None:
    assert {line: bus(*words(line)) for line in GOLDEN} == {
        line: Result(out, "", 0) for line, out in GOLDEN.items()
    }
    whole = bus("lifecycle", "list", "lc_talker", "-a")
    assert (whole.err, whole.code) == ("", 0)
    assert whole.out.startswith("- configure [1]\n\tStart: unconfigured\n\tGoal: configuring\n")
    assert whole.out.endswith("- transition_error [62]\n\tStart: errorprocessing\n\tGoal: finalized\n")
    assert whole.out.count("\n- ") == 24


def test_what_can_not_be(nodes: None) -> None:
    assert {line: bus(*words(line)) for line in REFUSED} == {
        line: Result("", text, 1) for line, text in REFUSED.items()
    }


def test_transitions(nodes: None) -> None:
    done = Result("Transitioning successful\n", "", 0)
    assert bus("lifecycle", "set", "/ns/lc", "configure") == done
    assert bus("lifecycle", "set", "ns/lc", "3") == done
    assert bus("lifecycle", "get", "/ns/lc").out == "active [3]\n"
    assert bus("lifecycle", "set", "/ns/lc", "shutdown", "--json") == Result(
        '{"node":"/ns/lc","transition":"shutdown","success":true}\n', "", 0
    )
    assert bus("lifecycle", "list", "/ns/lc") == Result("", "", 0)
    assert bus("lifecycle", "set", "/ns/lc", "shutdown") == Result("", f"{UNKNOWN}\n", 1)
    assert bus("lifecycle", "set", "lc_talker", "configure") == done
    assert bus("lifecycle", "set", "lc_talker", "activate") == Result("", "Transitioning failed\n", 1)
    assert bus("lifecycle", "set", "lc_talker", "activate", "--json").code == 1


def test_a_node_that_dies_of_it(daemon: object) -> None:
    """The caller gets the reason, and does not wait forever."""
    with script(BROKEN) as broken:
        why = (
            "TypeError: on_configure() of node '/lc_talker' must return a TransitionCallbackReturn,"
            " not NoneType"
        )
        result = bus("lifecycle", "set", "lc_talker", "configure")
        assert (result.out, result.code) == ("", 1)
        assert result.err.startswith("Exception while calling service of node '/lc_talker': ")
        assert result.err.endswith(f"{why}\n")
        died = broken.end()
        assert (died.err.rstrip().endswith(why), died.code) == (True, 1)


def test_two_that_serve_one_name(nodes: None) -> None:
    """Neither makes the transition."""
    with script(NODES):
        result = bus("lifecycle", "set", "/ns/lc", "configure")
        assert (result.out, result.code) == ("", 1)
        one = r"/ns/lc \(pid \d+\)"
        assert re.fullmatch(
            rf"'/ns/lc/change_state' is served 2 times, by {one}, {one}: rename one\n", result.err
        )
        assert bus("lifecycle", "get", "/ns/lc").out == "unconfigured [1]\n"


def test_completion(nodes: None) -> None:
    line = ["lifecycle", "set", "x", "y"]
    args = make_parser(line).parse_args(line)
    assert _complete_nodes("", args) == ["/lc_talker", "/ns/lc"]
    assert transitions("", args) == ("configure", "cleanup", "activate", "deactivate", "shutdown")
