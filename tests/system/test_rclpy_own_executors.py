"""Executors that a program defines itself with `wait_for_ready_callbacks`."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.executors import (
    ConditionReachedException,
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from conftest import WAIT_S
from rclpy_world import Int64, World, arguments, in_thread, is_waiting, trigger, wait_until, world

__all__ = ["arguments", "world"]


class Simple(Executor):
    """Runs callbacks in the spinning thread, as rclpy's executors do."""

    def spin_once(self, timeout_sec: float | None = None) -> None:
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=timeout_sec)
        except (ShutdownException, TimeoutException):
            return
        handler()
        if (error := handler.exception()) is not None:
            raise error


class Pooled(Executor):
    """Runs callbacks in a thread pool."""

    pool: ThreadPoolExecutor

    def spin_once(self, timeout_sec: float | None = None) -> None:
        handler, _, _ = self.wait_for_ready_callbacks(timeout_sec)
        self.pool.submit(handler)


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(2) as pool:
        yield pool


def test_what_it_returns(world: World, node: Node) -> None:
    told: list[int] = []
    executor = world.executor(node)
    guard = node.create_guard_condition(lambda: told.append(1))
    guard.trigger()
    handler, entity, of = executor.wait_for_ready_callbacks()
    assert entity is guard and of is node and told == [] and not handler.done()
    assert not executor.can_execute(guard), "its group is held"
    handler()
    assert told == [1] and handler.done() and executor.can_execute(guard)
    task = executor.create_task(lambda: 5)
    assert executor.wait_for_ready_callbacks() == (task, None, None)
    task()
    assert task.result() == 5


def test_how_it_ends(world: World, node: Node) -> None:
    executor = world.executor(node)
    for timeout in (0, 0.01):
        with pytest.raises(TimeoutException):
            executor.wait_for_ready_callbacks(timeout_sec=timeout)
    with pytest.raises(ConditionReachedException):
        executor.wait_for_ready_callbacks(condition=lambda: True)
    ends: list[str] = []

    def wait(kind: type[Exception], condition: Any) -> None:
        with pytest.raises(kind):
            executor.wait_for_ready_callbacks(condition=condition)

    with in_thread(lambda: wait(ConditionReachedException, lambda: bool(ends))):
        wait_until(lambda: is_waiting(executor))
        ends.append("now")
        executor.wake()
    with in_thread(lambda: wait(ShutdownException, lambda: False)):
        wait_until(lambda: is_waiting(executor))
        executor.shutdown()
    with pytest.raises(ShutdownException):
        executor.wait_for_ready_callbacks()
    other = world.executor(node)
    rclpy.shutdown()
    with pytest.raises(ExternalShutdownException):
        other.wait_for_ready_callbacks()


def test_of_some_nodes_only(world: World, node: Node) -> None:
    other = world.node("other")
    executor = world.executor(node, other)
    trigger(node, lambda: None)
    trigger(other, lambda: None)
    handler, _, of = executor.wait_for_ready_callbacks(WAIT_S, [other])
    assert of is other
    handler()
    with pytest.raises(TimeoutException):
        executor.wait_for_ready_callbacks(timeout_sec=0, nodes=[other])
    assert executor.wait_for_ready_callbacks(WAIT_S)[2] is node


def test_spinning(world: World, node: Node) -> None:
    """Every way to spin uses the program's own spin_once."""
    heard: list[int] = []
    executor = world.executor(node, kind=Simple)
    node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
    publisher = node.create_publisher(Int64, "t", 10)
    for number in range(3):
        publisher.publish(Int64(data=number))
    world.spin_executor_until(lambda: len(heard) == 3, executor)
    future: Future[int] = Future()
    with in_thread(lambda: executor.spin_until_future_complete(future)):
        wait_until(lambda: is_waiting(executor))
        publisher.publish(Int64(data=3))
        wait_until(lambda: len(heard) == 4)
        future.set_result(1)
    executor.spin_until_future_complete(Future(), timeout_sec=0.01)
    trigger(node, lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        executor.spin()
    with in_thread(executor.spin):
        publisher.publish(Int64(data=4))
        wait_until(lambda: heard == [0, 1, 2, 3, 4])
        executor.shutdown()


def test_coroutines_hold_their_group(world: World, node: Node) -> None:
    told: list[str] = []
    gate: Future[None] = Future()

    async def hear(_: object) -> None:
        told.append("begins")
        await gate
        told.append("ends")

    node.create_subscription(Int64, "t", hear, 10)
    node.create_publisher(Int64, "t", 10).publish(Int64())
    executor = world.executor(node, kind=Simple)
    world.spin_executor_until(lambda: told, executor)
    trigger(node, lambda: told.append("other"))
    executor.spin_once(timeout_sec=0.01)
    assert told == ["begins"]
    gate.set_result(None)
    world.spin_executor_until(lambda: len(told) == 3, executor)
    assert told == ["begins", "ends", "other"]


def test_handlers_in_other_threads(world: World, node: Node, pool: ThreadPoolExecutor) -> None:
    """Handlers of a mutually exclusive group exclude each other; those of a reentrant group run together."""
    executor = world.executor(node, kind=Pooled)
    assert isinstance(executor, Pooled)
    executor.pool = pool
    meeting, told = threading.Barrier(2), []
    for _ in range(2):
        trigger(node, lambda: told.append(meeting.wait(WAIT_S)), ReentrantCallbackGroup())
        executor.spin_once(timeout_sec=WAIT_S)
    wait_until(lambda: len(told) == 2)
    gate = threading.Event()
    trigger(node, lambda: told.append(gate.wait(WAIT_S)))
    trigger(node, lambda: told.append(3))
    executor.spin_once(timeout_sec=WAIT_S)
    with pytest.raises(TimeoutException):
        executor.spin_once(timeout_sec=0.02)
    gate.set()
    executor.spin_once(timeout_sec=WAIT_S)
    wait_until(lambda: told[2:] == [True, 3])


@pytest.mark.parametrize("base", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_spin_once_that_adds_to_ours(world: World, node: Node, base: Any) -> None:
    turns = [0]

    class Counting(base):  # type: ignore[misc]
        def spin_once(self, timeout_sec: float | None = None) -> None:
            turns[0] += 1
            super().spin_once(timeout_sec)

    calls: list[int] = []
    node.create_timer(0.001, lambda: calls.append(1))
    with world.spinning(node, kind=lambda: Counting()):
        wait_until(lambda: len(calls) >= 5)
    assert turns[0] >= len(calls)


def test_one_without_a_spin_once(world: World, node: Node) -> None:
    executor = world.executor(node, kind=Executor)
    with pytest.raises(NotImplementedError, match="Executor has no spin_once"):
        executor.spin_once()
