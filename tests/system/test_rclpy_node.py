"""Nodes and contexts of the facade: names, the graph, making and destroying endpoints."""

import asyncio
import gc
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.engine import Waiter, engine
from bus_ros.rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.exceptions import (
    InvalidHandle,
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidTopicNameException,
    NodeNameNonExistentError,
    NotInitializedException,
    RCLError,
    RCLInvalidROSArgsError,
    UnknownROSArgsError,
)
from bus_ros.rclpy.executors import SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile, ReliabilityPolicy
from bus_ros.rclpy.service_introspection import ServiceIntrospectionState
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions
from bus_ros.rclpy.topic_endpoint_info import EndpointTypeEnum
from bus_ros.rosidl import message_class
from conftest import Daemon
from rclpy_world import AddTwoInts, Int64, String, World, arguments, wait_until, world

__all__ = ["arguments", "world"]


def nothing(*_: object) -> None: ...


class TestNames:
    def test_a_name_alone(self, world: World) -> None:
        node = world.node("walker")
        assert node.get_name() == "walker"
        assert node.get_namespace() == "/"
        assert node.get_fully_qualified_name() == "/walker"
        assert node.get_logger().name == "walker"
        assert repr(node) == "<Node /walker>"
        assert node.context is world.context is rclpy.get_default_context()

    @pytest.mark.parametrize("namespace", ["left/leg", "/left/leg"])
    def test_a_namespace(self, world: World, namespace: str) -> None:
        node = world.node("walker", namespace=namespace)
        assert node.get_namespace() == "/left/leg"
        assert node.get_fully_qualified_name() == "/left/leg/walker"
        assert node.get_logger().name == "left.leg.walker"
        assert node.resolve_topic_name("t") == "/left/leg/t"
        assert node.resolve_topic_name("~/t") == "/left/leg/walker/t"
        assert node.resolve_service_name("/s") == "/s"

    @pytest.mark.parametrize(
        "arguments",
        [["--ros-args", "-r", "__node:=other", "-r", "__ns:=/n", "-r", "a:=b", "-r", "s:=/t"]],
    )
    def test_the_command_line_renames(self, world: World) -> None:
        node = world.node("walker")
        assert node.get_fully_qualified_name() == "/n/other"
        assert node.create_publisher(String, "a", 10).topic_name == "/n/b"
        assert node.create_client(AddTwoInts, "s").service_name == "/t"
        assert node.resolve_topic_name("a") == "/n/b"
        apart = world.node("walker", use_global_arguments=False)
        assert apart.get_fully_qualified_name() == "/walker"
        assert apart.resolve_topic_name("a") == "/a"

    @pytest.mark.parametrize("arguments", [["--ros-args", "-r", "a:=b", "-r", "c:=d"]])
    def test_a_node_s_own_arguments_come_first(self, world: World) -> None:
        node = world.node(cli_args=["--ros-args", "-r", "a:=mine", "-r", "__node:=named"])
        assert node.get_name() == "named"
        assert node.resolve_topic_name("a") == "/mine"
        assert node.resolve_topic_name("c") == "/d"

    @pytest.mark.parametrize(
        "arguments", [["-p", "8080", "--log-level", "--ros-args", "-r", "c:=d", "--", "-r"]]
    )
    @pytest.mark.parametrize("own", [[], ["--"], ["--", "-p", "8081"]])
    def test_a_node_s_own_arguments_end_where_they_end(self, world: World, own: list[str]) -> None:
        """Later arguments, the node's or the program's, may look like ROS arguments but are none."""
        node = world.node(cli_args=["-r", "--ros-args", "-r", "a:=mine", "-p", "p:=3", *own])
        assert node.resolve_topic_name("a") == "/mine" and node.resolve_topic_name("c") == "/d"
        assert node.declare_parameter("p", 1).value == 3

    def test_a_node_s_own_arguments_that_are_wrong(self, world: World) -> None:
        with pytest.raises(RCLInvalidROSArgsError, match="trailing -p flag"):
            world.node(cli_args=["--ros-args", "-p"])
        with pytest.raises(RCLInvalidROSArgsError, match="'-r bad'"):
            world.node(cli_args=["--ros-args", "-r", "bad"])
        with pytest.raises(UnknownROSArgsError, match="--bad"):
            world.node(cli_args=["--ros-args", "--bad"])

    @pytest.mark.parametrize("arguments", [["--ros-args", "-r", "a:=b"]])
    def test_names_can_be_expanded_without_remapping(self, world: World) -> None:
        node = world.node(namespace="n")
        assert node.resolve_topic_name("a", only_expand=True) == "/n/a"
        assert node.resolve_service_name("a", only_expand=True) == "/n/a"
        assert node.resolve_service_name("a") == "/n/b"

    def test_names_that_are_wrong(self, world: World) -> None:
        with pytest.raises(InvalidNodeNameException):
            Node("no slash/please")
        with pytest.raises(InvalidNamespaceException):
            Node("n", namespace="2nd")
        node = world.node()
        with pytest.raises(InvalidTopicNameException):
            node.create_publisher(String, "bad topic", 10)
        with pytest.raises(InvalidTopicNameException):
            node.create_subscription(String, "2nd", nothing, 10)
        assert list(node.publishers) == list(node.subscriptions) == []

    def test_before_init(self, daemon: Daemon) -> None:
        with pytest.raises(NotInitializedException):
            Node("early", context=Context())


class TestEntities:
    def test_everything_is_made_and_destroyed(self, world: World) -> None:
        node = world.node()
        made: dict[str, tuple[Any, Any]] = {
            "publisher": (node.create_publisher(String, "t", 10), node.publishers),
            "subscription": (node.create_subscription(String, "t", nothing, 10), node.subscriptions),
            "service": (node.create_service(AddTwoInts, "s", nothing), node.services),
            "client": (node.create_client(AddTwoInts, "s"), node.clients),
            "timer": (node.create_timer(3600, nothing), node.timers),
            "guard_condition": (node.create_guard_condition(nothing), node.guards),
        }
        for kind, (entity, listed) in made.items():
            assert list(listed) == [entity], kind
            destroy = getattr(node, f"destroy_{kind}")
            assert destroy(entity) is True, kind
            assert destroy(entity) is False, kind
        assert node.destroy_rate(node.create_rate(1.0))
        for listed in (node.publishers, node.subscriptions, node.services, node.clients, node.timers):
            assert list(listed) == []

    def test_entities_destroy_themselves(self, world: World) -> None:
        node = world.node()
        with (
            node.create_publisher(String, "t", 10),
            node.create_subscription(String, "t", nothing, 10),
            node.create_service(AddTwoInts, "s", nothing),
            node.create_client(AddTwoInts, "s"),
        ):
            assert len(node.get_topic_names_and_types()) == 2  # and /rosout
        node.create_timer(3600, nothing).destroy()
        node.create_guard_condition(nothing).destroy()
        wait_until(lambda: node.get_topic_names_and_types() == [("/rosout", ["rcl_interfaces/msg/Log"])])
        assert list(node.timers) == list(node.guards) == []

    def test_keywords_alone(self, world: World) -> None:
        node = world.node()
        group = MutuallyExclusiveCallbackGroup()
        publisher = node.create_publisher(msg_type=String, topic="t", qos_profile=QoSProfile(depth=3))
        subscription = node.create_subscription(
            msg_type=String, topic="t", callback=nothing, qos_profile=3, callback_group=group
        )
        timer = node.create_timer(timer_period_sec=3600, callback=nothing, callback_group=group)
        service = node.create_service(srv_type=AddTwoInts, srv_name="s", callback=nothing)
        client = node.create_client(srv_type=AddTwoInts, srv_name="s", callback_group=group)
        assert (publisher.topic, subscription.topic, publisher.msg_type) == ("/t", "/t", String)
        assert publisher.qos_profile.depth == subscription.qos_profile.depth == 3
        assert (service.srv_name, client.srv_name, client.service_name) == ("s", "s", "/s")
        assert all(group.has_entity(one) for one in (subscription, timer, client))
        assert node.default_callback_group.has_entity(service)

    def test_what_can_not_be_made(self, world: World) -> None:
        node = world.node()
        with pytest.raises(AttributeError, match="ROS 2 message type"):
            node.create_publisher(int, "t", 10)
        with pytest.raises(RuntimeError, match="this might be a service or action"):
            node.create_subscription(AddTwoInts, "t", nothing, 10)
        with pytest.raises(RuntimeError, match="this might be a message or action"):
            node.create_service(String, "s", nothing)
        with pytest.raises(RCLError, match="must be non-negative"):
            node.create_timer(-1, nothing)
        with pytest.raises(ValueError, match="frequency must be > 0"):
            node.create_rate(0)
        with pytest.raises(TypeError, match="callback must be callable, not str"):
            node.create_subscription(String, "t", "nothing", 10)  # type: ignore[arg-type]
        with pytest.raises(TypeError):
            node.create_publisher(String, "t", "ten")  # type: ignore[arg-type]
        with pytest.raises(RCLError, match=r"the message has no field 'date'; did you mean 'data'\?"):
            node.create_subscription(
                String, "t", nothing, 10, content_filter_options=ContentFilterOptions("date = 1")
            )

    def test_a_profile_may_be_changed_and_used_again(self, world: World) -> None:
        node = world.node()
        profile = QoSProfile(depth=5)
        first = node.create_publisher(String, "t", profile)
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
        second = node.create_publisher(String, "t", profile)
        kinds = [one.qos_profile.reliability for one in (first, second)]
        assert kinds == [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT]

    def test_a_node_keeps_its_last_executor(self, world: World) -> None:
        node = world.node("kept")
        first, second = world.executor(node), world.executor()
        first.remove_node(node)
        assert node.executor is first and first.get_nodes() == []
        assert second.add_node(node) and node.executor is second
        second.shutdown()
        assert node.executor is second
        node.executor = first
        assert node.executor is first and first.get_nodes() == [node]
        node.executor = None
        assert node.executor is None and first.get_nodes() == []

    def test_a_nodes_last_executor_is_not_kept_alive(self, world: World) -> None:
        node = world.node("lone")
        executor = SingleThreadedExecutor(context=world.context)
        executor.add_node(node)
        executor.remove_node(node)
        del executor
        gc.collect()
        assert node.executor is None

    def test_names_to_count_must_be_texts(self, world: World) -> None:
        node: Any = world.node("counter")
        for count in (node.count_publishers, node.count_subscribers, node.count_clients, node.count_services):
            with pytest.raises(TypeError, match="a name must be a str, not int"):
                count(1)
            with pytest.raises(ValueError, match="is invalid"):
                count("42")
        with pytest.raises(TypeError, match="a name must be a str, not int"):
            node.get_publishers_info_by_topic(1)

    def test_a_task_after_spin_once(self, world: World) -> None:
        node = world.node("spun")
        executor = world.executor(node)
        executor.spin_once(timeout_sec=0.01)
        executor.remove_node(node)
        assert node.executor is not None
        task = node.executor.create_task(lambda: "done")
        executor.spin_until_future_complete(task, timeout_sec=5.0)
        assert task.result() == "done"

    def test_destroying_a_node(self, world: World) -> None:
        watcher = world.node("watcher")
        with world.node("gone") as node:
            executor = world.executor(node)
            node.create_publisher(String, "t", 10)
            timer = node.create_timer(0, nothing)
            assert watcher.count_publishers("t") == 1
        assert executor.get_nodes() == []
        assert node.executor is executor  # as in ROS 2
        assert list(node.publishers) == [] and not node.destroy_timer(timer)
        node.destroy_node()
        wait_until(lambda: watcher.get_node_names() == ["watcher"])
        assert watcher.count_publishers("t") == 0

    def test_what_a_destroyed_node_can_not_do(self, world: World) -> None:
        node = world.node()
        publisher = node.create_publisher(String, "t", 10)
        node.destroy_node()
        with pytest.raises(InvalidHandle, match="the publisher on '/t' is destroyed"):
            publisher.publish(String())
        for make in (
            lambda: node.create_publisher(String, "t", 10),
            lambda: node.create_subscription(String, "t", nothing, 10),
            lambda: node.create_client(AddTwoInts, "s"),
            lambda: node.create_service(AddTwoInts, "s", nothing),
        ):
            with pytest.raises(InvalidHandle, match="node '/tester' is destroyed"):
                make()


class TestGraph:
    @pytest.fixture
    def robot(self, world: World) -> Node:
        robot = world.node("robot", namespace="lab")
        robot.create_publisher(String, "t", QoSProfile(depth=3))
        robot.create_publisher(Int64, "n", 10)
        robot.create_subscription(String, "t", nothing, 10)
        robot.create_service(AddTwoInts, "add", nothing)
        robot.create_client(AddTwoInts, "/ask")
        return robot

    def test_names_and_types(self, world: World, robot: Node) -> None:
        other = world.node("other", enable_rosout=False)
        assert other.get_topic_names_and_types() == [
            ("/lab/n", ["std_msgs/msg/Int64"]),
            ("/lab/t", ["std_msgs/msg/String"]),
            ("/rosout", ["rcl_interfaces/msg/Log"]),
        ]
        with_services = dict(other.get_topic_names_and_types(no_demangle=True))
        assert len(with_services) == 7, with_services
        assert ("/lab/add", ["example_interfaces/srv/AddTwoInts"]) in other.get_service_names_and_types()
        assert sorted(other.get_node_names()) == ["other", "robot"]
        assert sorted(other.get_node_names_and_namespaces()) == [("other", "/"), ("robot", "/lab")]
        assert ("robot", "/lab", "/") in other.get_node_names_and_namespaces_with_enclaves()
        assert sorted(other.get_fully_qualified_node_names()) == ["/lab/robot", "/other"]

    def test_of_one_node(self, world: World, robot: Node) -> None:
        other = world.node("other")
        assert other.get_publisher_names_and_types_by_node("robot", "/lab") == [
            ("/lab/n", ["std_msgs/msg/Int64"]),
            ("/lab/t", ["std_msgs/msg/String"]),
            ("/rosout", ["rcl_interfaces/msg/Log"]),
        ]
        assert other.get_subscriber_names_and_types_by_node("robot", "/lab") == [
            ("/lab/t", ["std_msgs/msg/String"])
        ]
        assert other.get_service_names_and_types_by_node("robot", "/lab") == [
            ("/lab/add", ["example_interfaces/srv/AddTwoInts"])
        ]
        assert other.get_client_names_and_types_by_node("robot", "/lab") == [
            ("/ask", ["example_interfaces/srv/AddTwoInts"])
        ]
        for ask in (
            other.get_publisher_names_and_types_by_node,
            other.get_subscriber_names_and_types_by_node,
            other.get_service_names_and_types_by_node,
            other.get_client_names_and_types_by_node,
        ):
            with pytest.raises(NodeNameNonExistentError, match="/lab/nobody"):
                ask("nobody", "/lab")

    def test_counts(self, world: World, robot: Node) -> None:
        other = world.node("other")
        assert (robot.count_publishers("t"), robot.count_subscribers("t")) == (1, 1)
        assert (other.count_publishers("t"), other.count_subscribers("t")) == (0, 0)
        assert (other.count_publishers("/lab/n"), other.count_subscribers("/lab/n")) == (1, 0)
        assert (robot.count_services("add"), robot.count_clients("add")) == (1, 0)
        assert (robot.count_services("/ask"), robot.count_clients("/ask")) == (0, 1)
        with pytest.raises(ValueError, match="topic name 'bad topic' is invalid"):
            robot.count_publishers("bad topic")

    def test_ends_of_services(self, world: World, robot: Node) -> None:
        (server,) = robot.get_servers_info_by_service("add")
        (client,) = robot.get_clients_info_by_service("/ask")
        for info, kind in ((server, EndpointTypeEnum.SERVER), (client, EndpointTypeEnum.CLIENT)):
            assert (info.node_name, info.node_namespace) == ("robot", "/lab")
            assert (info.service_type, info.endpoint_type) == ("example_interfaces/srv/AddTwoInts", kind)
            assert info.endpoint_count == len(info.endpoint_gids) == len(info.qos_profiles) == 2
            assert str(info.service_type_hash) == (
                "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
            )
        assert robot.get_servers_info_by_service("/ask") == []

    def test_endpoints(self, world: World, robot: Node) -> None:
        (publisher,) = robot.get_publishers_info_by_topic("t")
        (subscription,) = robot.get_subscriptions_info_by_topic("t")
        assert (publisher.node_name, publisher.node_namespace) == ("robot", "/lab")
        assert publisher.topic_type == "std_msgs/msg/String"
        assert publisher.qos_profile.depth == 3
        assert publisher.endpoint_type == EndpointTypeEnum.PUBLISHER
        assert subscription.endpoint_type == EndpointTypeEnum.SUBSCRIPTION
        assert publisher.endpoint_gid != subscription.endpoint_gid
        assert publisher.topic_type_hash == subscription.topic_type_hash
        assert robot.get_publishers_info_by_topic("nobody") == []

    @pytest.mark.parametrize("arguments", [["--ros-args", "-r", "a:=b"]])
    def test_questions_are_remapped_too(self, world: World) -> None:
        node = world.node()
        node.create_publisher(String, "a", 10)
        assert node.count_publishers("a") == node.count_publishers("b") == 1
        assert len(node.get_publishers_info_by_topic("a")) == 1

    def test_rosout_is_there_unless_it_is_not_wanted(self, world: World) -> None:
        with_it, without = world.node("with_it"), world.node("without", enable_rosout=False)
        infos = with_it.get_publishers_info_by_topic("/rosout")
        assert [one.node_name for one in infos] == ["with_it"]
        heard: list[Any] = []
        log = next(iter(dict(with_it.get_topic_names_and_types())["/rosout"]))
        assert log == "rcl_interfaces/msg/Log"
        with_it.create_subscription(message_class(log), "/rosout", heard.append, 10)
        without.get_logger().info("unheard")
        with_it.get_logger().info("heard")
        world.spin_until(lambda: heard, with_it)
        assert [(one.name, one.msg) for one in heard] == [("with_it", "heard")]


def test_a_node_destroys_only_its_own(world: World) -> None:
    owner, other = world.node("owner"), world.node("other")
    rate = owner.create_rate(100)
    parts: dict[str, Any] = {
        "publisher": owner.create_publisher(Int64, "t", 10),
        "subscription": owner.create_subscription(Int64, "t", nothing, 10),
        "client": owner.create_client(AddTwoInts, "add"),
        "service": owner.create_service(AddTwoInts, "add", nothing),
        "timer": owner.create_timer(100, nothing),
        "guard_condition": owner.create_guard_condition(nothing),
    }
    parts["client"].configure_introspection(owner.get_clock(), 10, ServiceIntrospectionState.METADATA)
    for kind, part in parts.items():
        assert getattr(other, f"destroy_{kind}")(part) is False
        assert not part.is_destroyed
    assert parts["client"].events is not None
    assert other.destroy_rate(rate) is False
    rate.sleep()
    for kind, part in parts.items():
        assert getattr(owner, f"destroy_{kind}")(part) is True
        assert part.is_destroyed
        assert getattr(owner, f"destroy_{kind}")(part) is False
    assert owner.destroy_rate(rate) is True
    with pytest.raises(RuntimeError, match="it has been destroyed"):
        rate.sleep()


def test_calls_in_series_change_threads_once(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that makes a node's endpoints runs the loop itself from the second one on."""
    mover = engine()
    world.node()
    wait_until(lambda: mover._runner is mover)  # the keeper runs the loop
    blocked: list[Waiter] = []
    block = Waiter.block

    def count(self: Waiter, timeout_s: float | None) -> None:
        blocked.append(self)
        block(self, timeout_s)

    monkeypatch.setattr(Waiter, "block", count)
    for _ in range(20):
        mover.run(lambda: asyncio.sleep(0))
    assert 1 <= len(blocked) <= 10


def test_a_node_waits_for_busd_a_few_times(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """One wait is for both endpoints of all six parameter services."""
    waits = 0
    run = type(engine()).run

    def count(*arguments: Any, **options: Any) -> Any:
        nonlocal waits
        waits += 1
        return run(*arguments, **options)

    monkeypatch.setattr(type(engine()), "run", count)
    node = world.keep(Node("starter"))
    assert (waits, len(list(node.services))) == (4, 7)
