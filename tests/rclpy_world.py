"""Common parts of the facade's tests: a context on the test's daemon, waits, and clean-up.

    def test_x(world: World) -> None:
        node = world.node("tester")
        world.spin_until(lambda: heard)

Import the fixture `world` as well as the class. At its end it shuts everything down, ends the engine, and
fails if a thread is left.
"""

import gc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

import pytest

import bus_ros.rclpy as rclpy
from bus_ros import engine as engines
from bus_ros.rclpy.callback_groups import CallbackGroup
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.executors import EventsExecutor, Executor, MultiThreadedExecutor, SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.signals import SignalHandlerOptions
from bus_ros.rclpy.type_description_service import START_TYPE_DESCRIPTION_SERVICE_PARAM
from bus_ros.rosidl import message_class, service_class
from conftest import WAIT_S, Daemon
from neighbours import wait_until
from semantics import accounted

__all__ = [
    "AddTwoInts",
    "Int64",
    "Kind",
    "String",
    "World",
    "add",
    "arguments",
    "arrived",
    "every_kind",
    "in_thread",
    "is_waiting",
    "trigger",
    "wait_until",
    "world",
]

String: Any = message_class("std_msgs/msg/String")
Int64: Any = message_class("std_msgs/msg/Int64")
AddTwoInts: Any = service_class("example_interfaces/srv/AddTwoInts")


Kind: TypeAlias = Callable[[], Executor]

every_kind = pytest.mark.parametrize(
    "kind",
    [SingleThreadedExecutor, lambda: MultiThreadedExecutor(3), EventsExecutor],
    ids=["single", "multi", "events"],
)
"""Mark: the test runs with each kind of executor."""


class World:
    """The default context, initialized, and the nodes and executors of a test."""

    def __init__(self, arguments: list[str]) -> None:
        self.context = rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO).context
        self._nodes: list[Node] = []
        self._executors: list[Executor] = []

    def node(self, name: str = "tester", **options: Any) -> Node:
        """A node; without the services of parameters and types, which few tests need."""
        options.setdefault("start_parameter_services", False)
        off = Parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, value=False)
        options["parameter_overrides"] = [*(options.get("parameter_overrides") or ()), off]
        return self.keep(Node(name, **options))

    def keep(self, node: Node) -> Node:
        """Destroy the node at the end."""
        self._nodes.append(node)
        return node

    def nodes(self) -> list[Node]:
        """The nodes that it made."""
        return list(self._nodes)

    def executor(self, *nodes: Node, kind: Kind = SingleThreadedExecutor) -> Executor:
        """An executor with these nodes; it is shut down at the end."""
        executor = kind()
        self._executors.append(executor)
        for node in nodes:
            executor.add_node(node)
        return executor

    def spin_until(self, condition: Callable[[], object], *nodes: Node) -> None:
        """Spin in this thread with `nodes`, by default all without an executor."""
        executor = self.executor(*(nodes or (one for one in self._nodes if one.own_executor is None)))
        self.spin_executor_until(condition, executor)
        executor.shutdown()

    def spin_executor_until(self, condition: Callable[[], object], executor: Executor) -> None:
        end = time.monotonic() + WAIT_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError("it did not come about")
            executor.spin_once(timeout_sec=0.01)

    @contextmanager
    def spinning(self, *nodes: Node, kind: Kind = SingleThreadedExecutor) -> Iterator[Executor]:
        """An executor that spins in a separate thread; its exception is raised at the end."""
        executor = self.executor(*nodes, kind=kind)
        with in_thread(executor.spin):
            try:
                yield executor
            finally:
                executor.shutdown()

    def end(self) -> None:
        for executor in self._executors:
            executor.shutdown()
        for node in self._nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        for context in Context.all():
            context.try_shutdown()
        engines.end()


@contextmanager
def in_thread(function: Callable[[], object]) -> Iterator[threading.Thread]:
    """Run a function in a thread; leaving waits for its end, and raises its exception."""
    errors: list[BaseException] = []

    def run() -> None:
        try:
            function()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="in_thread")
    thread.start()
    try:
        yield thread
    finally:
        thread.join(WAIT_S)
    assert not thread.is_alive(), "the thread has not ended"
    if errors:
        raise errors[0]


def add(request: Any, response: Any) -> Any:
    """A callback for AddTwoInts."""
    response.sum = request.a + request.b
    return response


def trigger(node: Node, callback: Callable[[], object], group: CallbackGroup | None = None) -> None:
    """Let `node` call a callback once."""
    node.create_guard_condition(callback, group).trigger()


def is_waiting(executor: Executor) -> bool:
    """Whether the spinning thread has nothing to do now, and runs the loop."""
    return executor._engine._runner is executor.waiter


def arrived(subscription: Any) -> int:
    """The number of its messages so far: taken, waiting or replaced."""
    with subscription._engine.loop:
        return accounted(subscription.native)


@pytest.fixture
def arguments() -> list[str]:
    """The command line of the test's context; tests set it by parametrization."""
    return []


@pytest.fixture
def world(daemon: Daemon, arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # rclpy.init sets its own
    before = set(threading.enumerate())
    world = World(arguments)
    try:
        yield world
    finally:
        world.end()
        gc.collect()
    left = set(threading.enumerate()) - before
    for thread in left:
        thread.join(WAIT_S)  # it may be about to end
    left = {thread for thread in left if thread.is_alive()}
    assert not left, f"threads left: {left}"
