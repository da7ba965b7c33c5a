"""Parameters of a node of the facade, end to end: events, services, the command line."""

from pathlib import Path
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.exceptions import (
    InvalidParameterTypeException,
    ParameterAlreadyDeclaredException,
    ParameterNotDeclaredException,
)
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.parameter_client import AsyncParameterClient
from bus_ros.rclpy.qos import qos_profile_parameter_events
from bus_ros.rosidl import message_class
from conftest import WAIT_S
from rclpy_world import World, arguments, wait_until, world

__all__ = ["arguments", "world"]

Result: Any = message_class("rcl_interfaces/msg/SetParametersResult")
Event: Any = message_class("rcl_interfaces/msg/ParameterEvent")
Descriptor: Any = message_class("rcl_interfaces/msg/ParameterDescriptor")


@pytest.fixture
def node(world: World) -> Node:
    return world.node("tester", start_parameter_services=True)


class TestInTheNode:
    def test_declare_get_and_set(self, node: Node) -> None:
        parameter = node.declare_parameter("speed", 1.5)
        assert (parameter.name, parameter.value, parameter.type_) == ("speed", 1.5, Parameter.Type.DOUBLE)
        assert node.get_parameter("speed").get_parameter_value().double_value == 1.5
        assert [one.successful for one in node.set_parameters([Parameter("speed", value=2.5)])] == [True]
        assert node.get_parameter("speed").value == 2.5
        assert node.has_parameter("speed") and not node.has_parameter("nosuch")
        with pytest.raises(ParameterAlreadyDeclaredException):
            node.declare_parameter("speed", 1.0)
        with pytest.raises(ParameterNotDeclaredException):
            node.get_parameter("nosuch")
        other = Parameter("nosuch", value="other")
        assert node.get_parameter_or("nosuch", other) is other

    def test_several(self, node: Node) -> None:
        made = node.declare_parameters("leg", [("a", 1), ("b", "x", Descriptor(description="the b"))])
        assert [one.name for one in made] == ["leg.a", "leg.b"]
        assert [one.value for one in node.get_parameters(["leg.b", "leg.a"])] == ["x", 1]
        assert {name: one.value for name, one in node.get_parameters_by_prefix("leg").items()} == {
            "a": 1,
            "b": "x",
        }
        assert node.get_parameter_types(["leg.a", "leg.b"]) == [
            Parameter.Type.INTEGER.value,
            Parameter.Type.STRING.value,
        ]
        assert node.get_parameter_type("leg.a") == Parameter.Type.INTEGER.value
        assert node.describe_parameter("leg.b").description == "the b"
        assert [one.name for one in node.describe_parameters(["leg.a"])] == ["leg.a"]
        assert sorted(node.list_parameters(["leg"], 0).names) == ["leg.a", "leg.b"]
        node.set_descriptor("leg.a", Descriptor(description="new", type=Parameter.Type.INTEGER.value))
        assert node.describe_parameter("leg.a").description == "new"

    def test_dynamic_ones_can_be_undeclared(self, node: Node) -> None:
        node.declare_parameter("p", 1, Descriptor(dynamic_typing=True))
        node.set_parameters([Parameter("p", value="text")])
        assert node.get_parameter("p").value == "text"
        node.undeclare_parameter("p")
        assert not node.has_parameter("p")

    def test_callbacks(self, node: Node) -> None:
        node.declare_parameter("p", 1)
        told: list[tuple[str, Any]] = []

        def pre(parameters: list[Parameter]) -> list[Parameter]:
            told.append(("pre", parameters[0].value))
            return parameters

        def check(parameters: list[Parameter]) -> Any:
            told.append(("on", parameters[0].value))
            return Result(successful=parameters[0].value < 10, reason="too much")

        def post(parameters: list[Parameter]) -> None:
            told.append(("post", node.get_parameter("p").value))

        node.add_pre_set_parameters_callback(pre)
        node.add_on_set_parameters_callback(check)
        node.add_post_set_parameters_callback(post)
        assert node.set_parameters([Parameter("p", value=5)])[0].successful
        refused = node.set_parameters_atomically([Parameter("p", value=50)])
        assert (refused.successful, refused.reason) == (False, "too much")
        assert told == [("pre", 5), ("on", 5), ("post", 5), ("pre", 50), ("on", 50)]
        node.remove_pre_set_parameters_callback(pre)
        node.remove_on_set_parameters_callback(check)
        node.remove_post_set_parameters_callback(post)
        assert node.set_parameters([Parameter("p", value=50)])[0].successful
        assert len(told) == 5

    def test_a_callback_may_publish(self, world: World, node: Node) -> None:
        """It may also make calls that need the loop, because it runs without the guard."""
        publisher = node.create_publisher(Event, "t", 10)
        heard: list[Any] = []
        node.create_subscription(Event, "t", heard.append, 10)
        node.declare_parameter("p", 1)
        node.add_post_set_parameters_callback(lambda _: publisher.publish(Event(node="mine")))
        node.set_parameters([Parameter("p", value=2)])
        world.spin_until(lambda: heard)
        assert heard[0].node == "mine"


class TestWhatNodesBeginWith:
    def test_overrides_of_the_constructor(self, world: World) -> None:
        node = world.node(parameter_overrides=[Parameter("p", value=7)])
        assert node.declare_parameter("p", 1).value == 7
        assert node.declare_parameter("q", 1).value == 1
        ignored = world.node("other", parameter_overrides=[Parameter("p", value=7)])
        assert ignored.declare_parameter("p", 1, ignore_override=True).value == 1

    @pytest.mark.parametrize(
        "arguments", [["--ros-args", "-p", "p:=5", "-p", "other:q:=text", "-p", "list:=[1.5, 2.0]"]]
    )
    def test_the_command_line(self, world: World) -> None:
        node, other = world.node(), world.node("other")
        assert node.declare_parameter("p", 1).value == 5
        assert node.declare_parameter("q", "none").value == "none"
        assert other.declare_parameter("q", "none").value == "text"
        assert list(node.declare_parameter("list", [0.0]).value) == [1.5, 2.0]
        with pytest.raises(InvalidParameterTypeException):
            other.declare_parameter("p", "a string")

    def test_a_file(self, world: World, tmp_path: Path) -> None:
        path = tmp_path / "p.yaml"
        path.write_text("/**:\n  ros__parameters:\n    a: 1\ntester:\n  ros__parameters:\n    b: {c: x}\n")
        node = world.node(
            cli_args=["--ros-args", "--params-file", str(path)],
            automatically_declare_parameters_from_overrides=True,
        )
        assert node.get_parameter("a").value == 1
        assert node.get_parameter("b.c").value == "x"

    def test_undeclared_ones_may_be_allowed(self, world: World) -> None:
        node = world.node(allow_undeclared_parameters=True)
        assert node.get_parameter("p").type_ == Parameter.Type.NOT_SET
        assert node.set_parameters([Parameter("p", value=3)])[0].successful
        assert node.get_parameter("p").value == 3

    def test_every_node_has_use_sim_time(self, node: Node) -> None:
        assert node.get_parameter("use_sim_time").value is False

    def test_nodes_without_services(self, world: World) -> None:
        world.node("plain")
        watcher = world.node("watcher", start_parameter_services=True)
        assert watcher.get_service_names_and_types_by_node("plain", "/") == []
        names = [name for name, _ in watcher.get_service_names_and_types_by_node("watcher", "/")]
        assert {"/watcher/get_parameters", "/watcher/set_parameters"} <= set(names)


class TestOnTheBus:
    def test_events_tell_of_changes(self, world: World, node: Node) -> None:
        events: list[Any] = []
        listener = world.node("listener")
        listener.create_subscription(Event, "/parameter_events", events.append, qos_profile_parameter_events)
        node.declare_parameter("p", 1, Descriptor(dynamic_typing=True))
        node.set_parameters([Parameter("p", value=2)])
        node.set_parameters([Parameter("p", Parameter.Type.NOT_SET)])

        def told(kind: str) -> list[Any]:
            found = [(one.name, one.value.integer_value) for e in events for one in getattr(e, kind)]
            return [one for one in found if one[0] == "p"]

        world.spin_until(lambda: told("deleted_parameters"), listener)
        assert told("new_parameters") == [("p", 1)]
        assert told("changed_parameters") == [("p", 2)]
        assert all(one.node == "/tester" and one.stamp.sec > 0 for one in events)

    def test_services_called_by_a_client(self, world: World, node: Node) -> None:
        node.declare_parameter("p", 1)
        node.declare_parameter("fixed", "x", Descriptor(read_only=True))
        asker = world.node("asker")
        client = AsyncParameterClient(asker, "tester")
        assert client.wait_for_services(timeout_sec=WAIT_S) and client.services_are_ready()

        def answer(future: Any) -> Any:
            rclpy.spin_until_future_complete(asker, future, timeout_sec=WAIT_S)
            return future.result()

        with world.spinning(node):
            values = answer(client.get_parameters(["p", "nosuch", "fixed"])).values
            assert [(one.integer_value, one.string_value) for one in values] == [(1, ""), (0, ""), (0, "x")]
            results = answer(
                client.set_parameters([Parameter("p", value=9), Parameter("fixed", value="y")])
            ).results
            assert [one.successful for one in results] == [True, False]
            assert "read-only" in results[1].reason
            assert {"p", "fixed", "use_sim_time"} <= set(answer(client.list_parameters()).result.names)
            assert list(answer(client.get_parameter_types(["p", "fixed"])).types) == [2, 4]
            assert answer(client.describe_parameters(["fixed"])).descriptors[0].read_only
            atomically = client.set_parameters_atomically(
                [Parameter("p", value=10), Parameter("fixed", value="z")]
            )
            assert not answer(atomically).result.successful
        assert node.get_parameter("p").value == 9

    def test_a_wrong_request_leaves_the_server_alone(self, world: World, node: Node) -> None:
        node.declare_parameter("p", 1)
        asker = world.node("asker")
        client = AsyncParameterClient(asker, "tester")
        assert client.wait_for_services(timeout_sec=WAIT_S)
        with world.spinning(node):
            future = client.set_parameters([Parameter("p", value="text"), Parameter("nosuch", value=1)])
            rclpy.spin_until_future_complete(asker, future, timeout_sec=WAIT_S)
            assert [one.successful for one in future.result().results] == [False, False]
            again = client.get_parameters(["p"])
            rclpy.spin_until_future_complete(asker, again, timeout_sec=WAIT_S)
            assert again.result().values[0].integer_value == 1

    def test_simulated_time_set_from_outside(self, world: World, node: Node) -> None:
        asker = world.node("asker")
        client = AsyncParameterClient(asker, "tester")
        assert client.wait_for_services(timeout_sec=WAIT_S)
        with world.spinning(node):
            future = client.set_parameters([Parameter("use_sim_time", value=True)])
            rclpy.spin_until_future_complete(asker, future, timeout_sec=WAIT_S)
            assert future.result().results[0].successful
            wait_until(lambda: node.get_clock().ros_time_is_active)
            wait_until(lambda: asker.count_subscribers("/clock") == 1)
