"""Runs of messages that an executor of the facade takes at once: faster, with the same results."""

import threading
import time
from typing import Any

import pytest

from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from rclpy_world import Int64, Kind, World, arguments, arrived, every_kind, trigger, wait_until, world

__all__ = ["arguments", "world"]

COUNT = 400


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


def fill(node: Node, subscription: Any, count: int = COUNT) -> None:
    """Queues messages, numbered from 0."""
    publisher = node.create_publisher(Int64, "t", COUNT)
    for number in range(count):
        publisher.publish(Int64(data=number))
    wait_until(lambda: arrived(subscription) == count)


def test_threads_take_runs_of_exclusive_callbacks(
    world: World, node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[int] = []
    fill(node, node.create_subscription(Int64, "t", lambda message: heard.append(message.data), COUNT))
    executor: Any = world.executor(node, kind=lambda: MultiThreadedExecutor(2))
    changes, hand = [0], executor._pool.hand

    def count(*work: Any) -> None:
        changes[0] += 1
        hand(*work)

    monkeypatch.setattr(executor._pool, "hand", count)
    trigger(node, lambda: None)
    with world.spinning(kind=lambda: executor):
        wait_until(lambda: len(heard) == COUNT)
    assert heard == list(range(COUNT))
    assert changes[0] < COUNT / 4


def test_a_spin_once_of_threads_is_one_message(world: World, node: Node) -> None:
    heard: list[int] = []
    fill(node, node.create_subscription(Int64, "t", lambda message: heard.append(message.data), COUNT), 20)
    executor = world.executor(node, kind=lambda: MultiThreadedExecutor(2))
    for number in range(20):
        executor.spin_once()
        wait_until(lambda number=number: len(heard) > number)
        assert heard == list(range(number + 1))


@every_kind
def test_what_takes_long_gives_way(world: World, node: Node, kind: Kind) -> None:
    """After many quick calls, slow ones run one at a time, so that others of the group get their turn."""
    told: list[str] = []

    def hear(message: Any) -> None:
        if message.data >= COUNT - 20:
            time.sleep(0.005)
            told.append("slow")

    fill(node, node.create_subscription(Int64, "t", hear, COUNT))
    node.create_timer(0.001, lambda: told.append("timer"))
    with world.spinning(node, kind=kind):
        wait_until(lambda: told.count("slow") == 20)
    assert "timer" in told[: told.index("slow") + 3]
    assert "slow slow slow" not in " ".join(told)


@every_kind
def test_the_rest_of_a_run_is_for_the_next(world: World, node: Node, kind: Kind) -> None:
    """After a shutdown of the executor in the middle of a run, and after an exception."""
    heard: list[int] = []

    def hear(message: Any) -> None:
        heard.append(message.data)
        if message.data == 100:
            executors[0].shutdown()
        if message.data == 250:
            raise LookupError("in a run")

    fill(node, node.create_subscription(Int64, "t", hear, COUNT))
    executors = [world.executor(node, kind=kind)]
    executors[0].spin()
    wait_until(lambda: len(heard) == 101)
    second = world.executor(node, kind=kind)
    with pytest.raises(LookupError, match="in a run"):
        second.spin()
    assert heard == list(range(251))
    world.spin_executor_until(lambda: len(heard) == COUNT, second)
    assert heard == list(range(COUNT))


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, lambda: MultiThreadedExecutor(2)])
def test_a_nested_spin_keeps_the_order(world: World, node: Node, kind: Kind) -> None:
    """A callback that spins is in no other call meanwhile, while callbacks of other groups are called."""
    heard: list[int] = []
    inside, most, others = 0, 0, 0

    def count() -> None:
        nonlocal others
        others += 1

    def hear(message: Any) -> None:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        heard.append(message.data)
        if message.data % 3 == 0:
            executor.spin_once(timeout_sec=0)
        if message.data == COUNT - 1:
            executor.shutdown()
        inside -= 1

    fill(node, node.create_subscription(Int64, "t", hear, COUNT))
    node.create_timer(0, count, ReentrantCallbackGroup())
    executor = world.executor(node, kind=kind)
    executor.spin()
    assert heard == list(range(COUNT))
    assert most == 1 and others > 0


def test_callbacks_of_a_group_never_meet(world: World, node: Node) -> None:
    """Runs, timers and other subscriptions of one group, with several threads."""
    inside, most, heard = [0], [0], [0]

    def enter(_: object = None) -> None:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        heard[0] += 1
        time.sleep(0)
        inside[0] -= 1

    subscriptions = [node.create_subscription(Int64, "t", enter, COUNT) for _ in range(3)]
    node.create_timer(0.0005, enter)
    for subscription in subscriptions:
        assert arrived(subscription) == 0
    fill(node, subscriptions[0])
    with world.spinning(node, kind=lambda: MultiThreadedExecutor(4)):
        wait_until(lambda: heard[0] >= 3 * COUNT)
    assert most[0] == 1


def test_threads_that_are_never_idle_serve_all(world: World, node: Node) -> None:
    """Each thread is always busy; still, a timer and a task get their turn."""
    counts = [0, 0]
    group = ReentrantCallbackGroup()

    def work(index: int) -> None:
        counts[index] += 1

    for _ in range(3):
        node.create_timer(0, lambda: work(0), group)
    node.create_timer(0.002, lambda: work(1))
    with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)) as executor:
        wait_until(lambda: counts[1] >= 20)
        task = executor.create_task(threading.get_ident)
        wait_until(task.done)
    assert counts[0] > 20
