"""The Python API of ROS 2's tools, on nodes of a bus: the graph, parameters, actions and lifecycle nodes."""

import subprocess
import sys
from pathlib import Path
from textwrap import dedent
from threading import Event
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.action import ActionClient, ActionServer
from bus_ros.rclpy.lifecycle import LifecycleNode
from bus_ros.rclpy.node import NodeNameNonExistentError
from bus_ros.rclpy.parameter import Parameter
from bus_ros.ros2action import api as ros2action
from bus_ros.ros2cli.node.daemon import DaemonNode, is_daemon_running, shutdown_daemon, spawn_daemon
from bus_ros.ros2cli.node.direct import DirectNode
from bus_ros.ros2cli.node.strategy import NodeStrategy
from bus_ros.ros2lifecycle import api as ros2lifecycle
from bus_ros.ros2node import api as ros2node
from bus_ros.ros2param import api as ros2param
from bus_ros.ros2service import api as ros2service
from bus_ros.ros2topic import api as ros2topic
from bus_ros.rosidl import action_class, message_class
from cli import bus
from conftest import WAIT_S, Daemon
from rclpy_world import AddTwoInts, Int64, String, World, add, arguments, in_thread, world

__all__ = ["arguments", "world"]

Fibonacci: Any = action_class("example_interfaces/action/Fibonacci")
Transition: Any = message_class("lifecycle_msgs/msg/Transition")
ParameterValue: Any = message_class("rcl_interfaces/msg/ParameterValue")

TOPIC = ("/chatter", ["std_msgs/msg/String"])


# --- the graph


def test_topics(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    node = world.node("tester")
    other = world.node("talker", namespace="robot")
    other.create_publisher(String, "/chatter", 1)
    other.create_publisher(Int64, "_hidden/topic", 1)
    assert TOPIC in ros2topic.get_topic_names_and_types(node=node)
    assert "/robot/_hidden/topic" not in ros2topic.get_topic_names(node=node)
    assert "/robot/_hidden/topic" in ros2topic.get_topic_names(node=node, include_hidden_topics=True)

    assert ros2topic.get_msg_class(node, "chatter") is String
    assert ros2topic.get_msg_class(node, "/robot/_hidden/topic", include_hidden_topics=True) is Int64
    assert capsys.readouterr().out == ""
    assert ros2topic.get_msg_class(node, "/robot/_hidden/topic") is None
    assert capsys.readouterr().out == (
        "WARNING: topic [/robot/_hidden/topic] does not appear to be published yet\n"
    )
    with pytest.raises(RuntimeError, match="topic name 'a b' is invalid"):
        ros2topic.get_msg_class(node, "a b")
    other.create_subscription(Int64, "/chatter", print, 1)
    with pytest.raises(RuntimeError, match=r"'chatter', as it contains more than one type: \[std_msgs/msg/I"):
        ros2topic.get_msg_class(node, "chatter")


def test_waiting_for_a_topic(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    node, other = world.node("tester"), world.node("talker")
    found: list[Any] = []
    with in_thread(lambda: found.append(ros2topic.get_msg_class(node, "/chatter", blocking=True))):
        other.create_publisher(String, "/chatter", 1)
    assert found == [String]
    capsys.readouterr()


def test_services(world: World) -> None:
    node, other = world.node("tester"), world.node("adder")
    other.create_service(AddTwoInts, "/add", add)
    other.create_service(AddTwoInts, "/_hidden/add", add)
    types = ["example_interfaces/srv/AddTwoInts"]
    assert ros2service.get_service_names_and_types(node=node) == [("/add", types)]
    assert ros2service.get_service_names(node=node, include_hidden_services=True) == ["/_hidden/add", "/add"]
    assert ros2service.get_service_class(node, "/add", False) is AddTwoInts
    with pytest.raises(RuntimeError, match="Cannot find type for '/_hidden/add'"):
        ros2service.get_service_class(node, "/_hidden/add", False)
    assert types[0] in ros2service.service_type_completer()


def test_endpoints_of_a_node(world: World) -> None:
    node, other = world.node("tester"), world.node("talker", namespace="robot", enable_rosout=False)
    other.create_publisher(String, "/chatter", 1)
    other.create_subscription(Int64, "number", print, 1)
    other.create_service(AddTwoInts, "add", add)
    other.create_client(AddTwoInts, "/far/add")
    ActionServer(other, Fibonacci, "count", lambda goal: Fibonacci.Result())
    ActionClient(other, Fibonacci, "/far/count")
    assert ("talker", "/robot", "/robot/talker") in ros2node.get_node_names(node=node)
    assert ros2node.wait_for_node(node, "/robot/talker")

    def found(find: Any, **options: Any) -> list[tuple[str, list[str]]]:
        return [tuple(one) for one in find(node=node, remote_node_name="/robot/talker", **options)]

    action = ["example_interfaces/action/Fibonacci"]
    service = ["example_interfaces/srv/AddTwoInts"]
    assert TOPIC in found(ros2node.get_publisher_info)
    assert found(ros2node.get_subscriber_info) == [("/robot/number", ["std_msgs/msg/Int64"])]
    assert found(ros2node.get_service_server_info) == [("/robot/add", service)]
    assert found(ros2node.get_service_client_info) == [("/far/add", service)]
    assert found(ros2node.get_action_server_info) == [("/robot/count", action)]
    assert found(ros2node.get_action_client_info) == [("/far/count", action)]
    hidden = found(ros2node.get_publisher_info, include_hidden=True)
    assert "/robot/count/_action/status" in dict(hidden)
    with pytest.raises(NodeNameNonExistentError):
        ros2node.get_publisher_info(node=node, remote_node_name="/nothing")


def test_actions(world: World) -> None:
    node, other = world.node("tester"), world.node("counter", namespace="robot")
    ActionServer(other, Fibonacci, "count", lambda goal: Fibonacci.Result())
    ActionClient(node, Fibonacci, "/robot/count")
    types = ["example_interfaces/action/Fibonacci"]
    assert ros2action.get_action_names_and_types(node=node) == [("/robot/count", types)]
    assert ros2action.get_action_names(node=node) == ["/robot/count"]
    clients, servers = ros2action.get_action_clients_and_servers(node=other, action_name="count")
    assert (clients, servers) == ([("/tester", types)], [("/robot/counter", types)])
    with pytest.raises(ValueError):
        ros2action.get_action_clients_and_servers(node=node, action_name="a b")
    assert types[0] in ros2action.action_type_completer()


# --- parameters


def test_parameters_of_another_node(world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    node = world.node("tester")
    other = world.node("camera", start_parameter_services=True)
    other.declare_parameter("exposure", 1.5)
    other.declare_parameter("names", ["a", "b"])
    with world.spinning(other):
        got = ros2param.call_get_parameters(
            node=node, node_name="/camera", parameter_names=["exposure", "names", "nothing"]
        )
        assert [ros2param.get_value(parameter_value=one) for one in got.values] == [1.5, ["a", "b"], None]
        assert [ros2param.get_parameter_type_string(one.type) for one in got.values] == [
            *("double", "string array", "not set")
        ]
        new = Parameter("exposure", value=2.5).to_parameter_msg()
        (result,) = ros2param.call_set_parameters(node=node, node_name="/camera", parameters=[new]).results
        assert result.successful and other.get_parameter("exposure").value == 2.5
        (about,) = ros2param.call_describe_parameters(
            node=node, node_name="/camera", parameter_names=["exposure"]
        ).descriptors
        assert about.name == "exposure"
        listed = ros2param.call_list_parameters(node=node, node_name="/camera")
        assert listed is not None and listed.done()
        assert {"exposure", "names"} <= set(listed.result().result.names)

        file = tmp_path / "parameters.yaml"
        file.write_text("/camera:\n  ros__parameters: {exposure: 3.5, unknown: 1}\n")
        ros2param.load_parameter_file(
            node=node, node_name="/camera", parameter_file=str(file), use_wildcard=False
        )
        assert other.get_parameter("exposure").value == 3.5
    printed = capsys.readouterr()
    assert printed.out == "Set parameter exposure successful\n"
    assert printed.err.startswith("Set parameter unknown failed: ")
    assert list(node.clients) == [], "the clients of a call are destroyed after it"


def test_a_node_without_parameters(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2param, "_WAIT_S", 0.0)
    node = world.node("tester")
    with pytest.raises(RuntimeError, match="timed out waiting for parameter services for node /nothing"):
        ros2param.call_get_parameters(node=node, node_name="/nothing", parameter_names=["a"])
    assert ros2param.call_list_parameters(node=node, node_name="/nothing") is None


def test_parameters_in_a_callback(world: World) -> None:
    """A node that asks for them in the callback of another one, as rosapi does."""
    server, asking = world.node("rosapi"), world.node("rosapi_params")
    other = world.node("camera", start_parameter_services=True)
    other.declare_parameter("exposure", 1.5)
    client = world.node("caller").create_client(AddTwoInts, "/ask")

    def ask(request: Any, response: Any) -> Any:
        got = ros2param.call_get_parameters(node=asking, node_name="/camera", parameter_names=["exposure"])
        response.sum = int(got.values[0].double_value * 10)
        return response

    server.create_service(AddTwoInts, "/ask", ask)
    is_over = Event()

    def spin() -> None:
        while not is_over.is_set():
            rclpy.spin_once(server, timeout_sec=0.01)

    with world.spinning(other), in_thread(spin):
        try:
            assert client.call(AddTwoInts.Request(), timeout_sec=WAIT_S).sum == 15
        finally:
            is_over.set()


def test_values(capsys: pytest.CaptureFixture[str]) -> None:
    assert ros2param.get_value(parameter_value=ros2param.get_parameter_value("[1, 2]")) == [1, 2]
    assert ros2param.get_value(parameter_value=ParameterValue(type=99)) is None
    assert capsys.readouterr().out.startswith("Runtime error ")
    with pytest.raises(KeyError):
        ros2param.get_parameter_type_string(99)


# --- lifecycle nodes


def test_lifecycle_nodes(world: World) -> None:
    node = world.node("tester")
    managed = LifecycleNode("managed")
    world.keep(managed)
    world.node("plain")
    assert [one.full_name for one in ros2lifecycle.get_node_names(node=node)] == ["/managed"]
    with world.spinning(managed):
        (state,) = ros2lifecycle.call_get_states(node=node, node_names=["/managed"]).values()
        assert state.label == "unconfigured"
        now = ros2lifecycle.call_get_available_transitions(node=node, states={"/managed": state})
        assert {one.transition.label for one in now["/managed"]} == {"configure", "shutdown"}
        graph = ros2lifecycle.call_get_transition_graph(node=node, states={"/managed": None})
        assert {"configure", "activate"} <= {one.transition.label for one in graph["/managed"]}
        wanted = Transition(id=Transition.TRANSITION_CONFIGURE)
        assert ros2lifecycle.call_change_states(node=node, transitions={"/managed": wanted}) == {
            "/managed": True
        }
        after = ros2lifecycle.call_get_states(node=node, node_names=["/managed"])
        assert after["/managed"].label == "inactive"
    assert list(node.clients) == []


# --- nodes of tools


def test_a_strategy_in_a_program_with_a_context(world: World) -> None:
    talker = world.node("talker")
    talker.create_publisher(String, "/chatter", 1)
    with NodeStrategy(None) as node:
        assert node.direct_node is node.node is node and node.daemon_node is None
        assert node.get_name().startswith("_ros2cli_")
        assert TOPIC in ros2topic.get_topic_names_and_types(node=node)
        assert node.get_action_names_and_types() == []
        assert node.get_action_server_names_and_types_by_node("talker", "/") == []
        assert node.get_action_client_names_and_types_by_node("talker", "/") == []
    assert rclpy.ok()
    with pytest.raises(RuntimeError, match=r"must only be called once"):
        DirectNode(None)
    assert rclpy.ok()


PROGRAM = """
    import argparse, sys
    import bus.rclpy_compat
    import rclpy
    from ros2cli.node.{module} import {cls}, add_arguments
    from ros2node.api import get_node_names
    from ros2topic.api import get_msg_class
    from std_msgs.msg import String

    parser = argparse.ArgumentParser()
    add_arguments(parser)
    args = parser.parse_args(["--spin-time", "0.01"])
    with {cls}(args) as node:
        heard = []
        publisher = node.create_publisher(String, "/chatter", 1)
        node.create_subscription(get_msg_class(node, "/chatter"), "/chatter", heard.append, 1)
        while not heard:
            publisher.publish(String(data="hello"))
            rclpy.spin_once(node, timeout_sec=0.1)
        print(heard[0].data, len(get_node_names(node=node)), rclpy.ok())
        (own,) = get_node_names(node=node, include_hidden_nodes=True)
        print(own.full_name == f"/{{node.get_name()}}", node.get_parameter("use_sim_time").value)
    print(rclpy.ok())
"""


@pytest.mark.parametrize(("module", "cls"), [("direct", "DirectNode"), ("strategy", "NodeStrategy")])
def test_a_tool(module: str, cls: str, daemon: Daemon, tmp_path: Path) -> None:
    """It uses the node as a node of rclpy, as programs do that were written like ROS 2's tools."""
    program = tmp_path / "tool.py"
    program.write_text(dedent(PROGRAM.format(module=module, cls=cls)))
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["hello 0 True", "True False", "False"]


def test_the_daemon_of_tools(world: World) -> None:
    world.node("talker")
    assert is_daemon_running(None)
    assert not spawn_daemon(None)
    assert not shutdown_daemon(None, timeout=1)
    assert is_daemon_running(None)
    with DaemonNode(None) as node:
        assert node.connected
        assert "talker" in node.get_node_names()


def test_a_daemon_that_tools_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_SOCKET", str(tmp_path / "socket"))
    monkeypatch.setenv("BUSD_AUTOSTART", "1")
    assert not is_daemon_running(None)
    assert spawn_daemon(None, timeout=10.0)
    assert is_daemon_running(None)
    assert not spawn_daemon(None)
    assert bus("daemon", "stop").code == 0
