"""Mistakes of beginners: their error messages, and that existing nodes continue or end as they should."""

from collections.abc import Callable
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy import exceptions
from bus_ros.rclpy.node import Node
from rclpy_world import AddTwoInts, String, World, add, arguments, world

__all__ = ["arguments", "world"]

_Mistake = Callable[[Node], Any]


@pytest.fixture
def node(world: World) -> Node:
    return world.node("tester")


def ignore(message: Any) -> None:
    """A callback."""


NAMES: dict[str, tuple[str, int | None]] = {
    # name: the broken rule, and the place of the fault
    "my topic": ("topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'", 2),
    "1st": ("topic name token must not start with a number", 0),
    "a-b": ("topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'", 1),
    "": ("topic name must not be empty string", 0),
    "a/": ("topic name must not end with a forward slash", 1),
    "a//b": ("topic name must not contain repeated '/'", None),
}

CALLS: dict[str, tuple[_Mistake, type[Exception], str]] = {
    "spinning nothing": (lambda node: rclpy.spin(None), TypeError, "a node is needed here, not None"),  # type: ignore[arg-type]
    "spinning a class": (lambda node: rclpy.spin_once(Node), TypeError, "a node is needed here, not <class"),  # type: ignore[arg-type]
    "arguments in the wrong order": (
        lambda node: node.create_publisher("t", String, 1),  # type: ignore[arg-type]
        AttributeError,
        "This might be a ROS 1 message type",
    ),
    "a service as a message": (
        lambda node: node.create_publisher(AddTwoInts, "t", 1),
        RuntimeError,
        "this might be a service or action",
    ),
    "a message as a service": (
        lambda node: node.create_client(String, "t"),
        RuntimeError,
        "this might be a message or action",
    ),
    "a subscription's callback was called": (
        lambda node: node.create_subscription(String, "t", ignore(None), 1),  # type: ignore[arg-type]
        TypeError,
        "callback must be callable, not NoneType",
    ),
    "a service's callback was called": (
        lambda node: node.create_service(AddTwoInts, "add", add(AddTwoInts.Request(), AddTwoInts.Response())),
        TypeError,
        "callback must be callable, not AddTwoInts_Response",
    ),
    "None": (
        lambda node: node.create_publisher(String, "t", 1).publish(None),
        TypeError,
        r"Expected <class 'std_msgs.msg._string.String'>, got <class 'NoneType'>",
    ),
    "a text": (
        lambda node: node.create_publisher(String, "t", 1).publish("x"),
        TypeError,
        "got <class 'str'>",
    ),
    "a dictionary for a request": (
        lambda node: node.create_client(AddTwoInts, "add").call_async({"a": 1}),
        TypeError,
        "expected a AddTwoInts_Request, got dict",
    ),
    "no QoS": (
        lambda node: node.create_publisher(String, "t", None),  # type: ignore[arg-type]
        TypeError,
        "Expected QoSProfile or int, but received <class 'NoneType'>",
    ),
    "a depth below zero": (
        lambda node: node.create_publisher(String, "t", -1),
        ValueError,
        "depth must be greater than or equal to zero",
    ),
    "a period that is no number": (lambda node: node.create_timer("often", ignore), ValueError, "'often'"),  # type: ignore[arg-type]
    "a period below zero": (
        lambda node: node.create_timer(-1, ignore),
        exceptions.RCLError,
        "failed to create timer: timer period must be non-negative",
    ),
    "a timer's callback by its name": (
        lambda node: node.create_timer(1.0, "ignore"),  # type: ignore[arg-type]
        TypeError,
        "callback must be callable, not str",
    ),
    "a callback without an argument": (
        lambda node: node.create_subscription(String, "t", lambda: None, 1),
        RuntimeError,
        r"with one argument\(to get only the message\) or two",
    ),
    "a callback of three": (
        lambda node: node.create_subscription(String, "t", lambda a, b, c: None, 1),
        RuntimeError,
        "callback should be",
    ),
    "a rate of zero": (lambda node: node.create_rate(0), ValueError, "frequency must be > 0"),
    "a dictionary for parameters": (
        lambda node: node.set_parameters({"x": 1}),  # type: ignore[dict-item]
        TypeError,
        "parameter must be instance of type",
    ),
    "a parameter that nobody declared": (
        lambda node: node.get_parameter("x"),
        exceptions.ParameterNotDeclaredException,
        r"Invalid access to undeclared parameter\(s\): x",
    ),
    "a second init": (
        lambda node: rclpy.init(args=[]),
        RuntimeError,
        r"Context.init\(\) must only be called once",
    ),
}


@pytest.mark.parametrize("name", CALLS)
def test_calls(world: World, node: Node, name: str) -> None:
    mistake, kind, text = CALLS[name]
    with pytest.raises(kind, match=text):
        mistake(node)
    node.create_publisher(String, "t", 1).publish(String())


@pytest.mark.parametrize("name", NAMES)
def test_names(world: World, node: Node, name: str) -> None:
    rule, index = NAMES[name]
    kinds: list[tuple[type[Exception], Callable[[], Any]]] = [
        (exceptions.InvalidTopicNameException, lambda: node.create_publisher(String, name, 1)),
        (exceptions.InvalidTopicNameException, lambda: node.create_subscription(String, name, ignore, 1)),
        (exceptions.InvalidServiceNameException, lambda: node.create_client(AddTwoInts, name)),
        (exceptions.InvalidServiceNameException, lambda: node.create_service(AddTwoInts, name, add)),
    ]
    for kind, make in kinds:
        with pytest.raises(kind) as caught:
            make()
        what = "topic" if kind is exceptions.InvalidTopicNameException else "service"
        first, typed, caret = str(caught.value).split("\n")
        full = name if index is not None or not name else f"/{name}"  # this fault only shows in the full name
        assert (first, typed) == (f"Invalid {what} name: {rule}:", f"  '{full}'")
        assert index is None or caret == f"   {' ' * index}^"
    assert list(node.publishers) == list(node.clients) == []


class TestNoConstructor:
    """A class that does not call `super().__init__`, or not first."""

    class Forgetful(Node):
        def __init__(self, first: Callable[[Node], object]) -> None:
            first(self)

    @pytest.mark.parametrize(
        "use",
        [
            lambda node: node.get_logger().info("x"),
            lambda node: node.create_timer(1.0, ignore),
            lambda node: node.create_publisher(String, "t", 1),
            lambda node: node.declare_parameter("x", 1),
            rclpy.spin_once,
        ],
    )
    def test_it_says_so(self, world: World, use: Callable[[Node], object]) -> None:
        with pytest.raises(AttributeError, match=r"super\(\).__init__\(node_name\) has not been called"):
            self.Forgetful(use)

    def test_a_misspelt_attribute_is_something_else(self, node: Node) -> None:
        with pytest.raises(AttributeError) as caught:
            node.tiemr  # type: ignore[attr-defined]  # noqa: B018
        assert str(caught.value) == "'Node' object has no attribute 'tiemr'"
        assert not hasattr(node, "tiemr")


class TestNamesOfAProgram:
    """A program's node may use any name that rclpy's nodes do not have."""

    class Busy(Node):
        def __init__(self, name: str) -> None:
            super().__init__(name)
            self._engine = self._native = self._events = self._entities = self._store = 1
            self._declared = self._graph = self._overrides = self.entities = 2

        def _check(self) -> None: ...
        def _profile(self) -> None: ...
        def _add(self) -> None: ...
        def _remove(self) -> None: ...
        def _find(self) -> None: ...
        def _declare(self) -> None: ...

    def test_they_stay_and_the_node_works(self, world: World) -> None:
        node = self.Busy("busy")
        world.keep(node)
        heard: list[str] = []
        publisher = node.create_publisher(String, "t", 1)
        subscription = node.create_subscription(String, "t", lambda message: heard.append(message.data), 1)
        assert node.declare_parameter("x", 1).value == node.get_parameter("x").value == 1
        publisher.publish(String(data="a"))
        world.spin_until(lambda: heard == ["a"])
        assert node.count_publishers("t") == 1
        assert node.destroy_subscription(subscription)
        assert (node._engine, node.entities) == (1, 2)

    def test_the_node_has_few_that_are_not_mangled(self, node: Node) -> None:
        own = {name for name in {*vars(node), *dir(Node)} if name.startswith("_")}
        mangled = ("__", "_BaseNode__", "_Node__", "_NodeGraph__", "_NodeParameters__", "_NodeWaitables__")
        for_actions = {"_evict_entity", "_host_entity"}
        assert {name for name in own if not name.startswith(mangled)} == {
            *("_clock", "_context", "_default_callback_group", "_logger", "_rate_group", "_time_source"),
            "_type_description_service",
            *for_actions,
        }  # rclpy has these, except for the last two


class TestDestroyed:
    def test_what_a_node_had(self, world: World, node: Node) -> None:
        publisher = node.create_publisher(String, "t", 1)
        client = node.create_client(AddTwoInts, "add")
        node.destroy_node()
        with pytest.raises(exceptions.InvalidHandle, match="the publisher on '/t' is destroyed"):
            publisher.publish(String())
        with pytest.raises(exceptions.InvalidHandle, match="the publisher on '/t' is destroyed"):
            publisher.publish(b"\x91\xa0")
        with pytest.raises(exceptions.InvalidHandle, match="the client of service '/add' is destroyed"):
            client.call_async(AddTwoInts.Request())

    def test_what_it_is_to_make(self, world: World, node: Node) -> None:
        node.destroy_node()
        for make in (
            lambda: node.create_publisher(String, "t", 1),
            lambda: node.create_subscription(String, "t", ignore, 1),
            lambda: node.create_client(AddTwoInts, "add"),
            lambda: node.create_service(AddTwoInts, "add", add),
        ):
            with pytest.raises(exceptions.InvalidHandle, match="node '/tester' is destroyed"):
                make()


def test_a_done_callback_that_raises(world: World, node: Node) -> None:
    """`spin` raises the exception, even if no thread was spinning at the time of the call."""
    node.create_service(AddTwoInts, "add", add)
    future = node.create_client(AddTwoInts, "add").call_async(AddTwoInts.Request())

    def fail(future: Any) -> None:
        raise LookupError("no such sum")

    future.add_done_callback(fail)
    with pytest.raises(LookupError, match="no such sum"):
        world.executor(node).spin()
