"""Executors of the facade: the callbacks that they run, the time, the thread, and the end."""

import asyncio
import threading
from functools import partial
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.executors import MultiThreadedExecutor, await_or_execute
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from conftest import WAIT_S
from rclpy_world import (
    Int64,
    Kind,
    World,
    arguments,
    every_kind,
    in_thread,
    is_waiting,
    trigger,
    wait_until,
    world,
)

__all__ = ["arguments", "world"]


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


class TestNodes:
    def test_adding_and_removing(self, world: World, node: Node) -> None:
        executor = world.executor()
        assert executor.get_nodes() == []
        assert executor.add_node(node) is True
        assert executor.add_node(node) is False
        assert executor.get_nodes() == [node] and node.executor is executor
        executor.remove_node(node)
        executor.remove_node(node)
        assert executor.get_nodes() == [] and node.executor is executor

    @every_kind
    def test_a_node_moves(self, world: World, node: Node, kind: Kind) -> None:
        """Messages that arrive during the move are there for the next executor."""
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 1000)
        publisher = node.create_publisher(Int64, "t", 1000)
        executors = [world.executor(kind=kind) for _ in range(2)]
        for turn in range(6):
            executor = executors[turn % 2]
            node.executor = executor
            assert executors[(turn + 1) % 2].get_nodes() == []
            for number in range(10):
                publisher.publish(Int64(data=turn * 10 + number))
            world.spin_executor_until(lambda count=turn * 10 + 5: len(heard) >= count, executor)
        node.executor = None
        assert executor.get_nodes() == []
        world.spin_until(lambda: len(heard) == 60, node)
        assert heard == list(range(60))

    @every_kind
    def test_several_nodes(self, world: World, kind: Kind) -> None:
        heard: list[str] = []
        nodes = [world.node(f"n{index}") for index in range(3)]
        for node in nodes:
            name = node.get_name()
            node.create_subscription(Int64, "t", lambda _, name=name: heard.append(name), 10)
        nodes[0].create_publisher(Int64, "t", 10).publish(Int64())
        executor = world.executor(*nodes, kind=kind)
        world.spin_executor_until(lambda: len(heard) == 3, executor)
        assert sorted(heard) == ["n0", "n1", "n2"]

    def test_several_executors_in_threads(self, world: World) -> None:
        """Each node's callbacks run in the thread of its executor."""
        seen: dict[str, set[int]] = {}
        nodes = [world.node(f"n{index}") for index in range(3)]
        counts = dict.fromkeys((one.get_name() for one in nodes), 0)

        def note(name: str) -> None:
            seen.setdefault(name, set()).add(threading.get_ident())
            counts[name] += 1

        for node in nodes:
            name = node.get_name()
            node.create_subscription(Int64, "t", lambda _, name=name: note(name), 1000)
        publisher = nodes[0].create_publisher(Int64, "t", 1000)
        with world.spinning(nodes[0]), world.spinning(nodes[1]), world.spinning(nodes[2]):
            for number in range(300):
                publisher.publish(Int64(data=number))
            wait_until(lambda: all(count == 300 for count in counts.values()))
        assert all(len(threads) == 1 for threads in seen.values())
        assert len(set.union(*seen.values())) == 3

    def test_removed_nodes_are_left_alone(self, world: World, node: Node) -> None:
        told: list[str] = []
        other = world.node("other")
        executor = world.executor(node, other)
        trigger(node, lambda: told.append("removed"))
        executor.remove_node(node)
        trigger(other, lambda: told.append("there"))
        world.spin_executor_until(lambda: told, executor)
        executor.spin_once(timeout_sec=0)
        assert told == ["there"]
        world.spin_until(lambda: len(told) == 2, node)
        assert told == ["there", "removed"]


class TestSpinning:
    @every_kind
    def test_once_is_one_call(self, world: World, node: Node, kind: Kind) -> None:
        told: list[int] = []
        for index in range(3):
            trigger(node, lambda index=index: told.append(index), ReentrantCallbackGroup())
        executor = world.executor(node, kind=kind)
        for count in range(1, 4):
            executor.spin_once()
            wait_until(lambda count=count: len(told) == count)
        executor.spin_once(timeout_sec=0)
        assert told == [0, 1, 2]

    def test_once_is_one_message(self, world: World, node: Node) -> None:
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 100)
        publisher = node.create_publisher(Int64, "t", 100)
        for number in range(20):
            publisher.publish(Int64(data=number))
        for number in range(20):
            rclpy.spin_once(node, timeout_sec=WAIT_S)
            assert heard == list(range(number + 1))

    def test_once_with_nothing_to_do(self, world: World, node: Node) -> None:
        rclpy.spin_once(node, timeout_sec=0)
        rclpy.spin_once(node, timeout_sec=0.01)
        assert node.executor is not None and node.executor.get_nodes() == []

    @pytest.mark.parametrize("timeout", [None, -1])
    def test_once_waits_for_ever(self, world: World, node: Node, timeout: float | None) -> None:
        executor, told = world.executor(node), []
        guard = node.create_guard_condition(lambda: told.append(1))
        with in_thread(lambda: executor.spin_once(timeout_sec=timeout)):
            wait_until(lambda: is_waiting(executor))
            assert told == []
            guard.trigger()
        assert told == [1]

    @every_kind
    def test_until_a_future_is_done(self, world: World, node: Node, kind: Kind) -> None:
        future: Future[int] = Future()
        executor = world.executor(node, kind=kind)
        trigger(node, lambda: future.set_result(4))
        executor.spin_until_future_complete(future, timeout_sec=WAIT_S)
        assert future.result() == 4
        executor.spin_until_future_complete(future)

    @every_kind
    def test_until_a_future_that_another_thread_has(self, world: World, node: Node, kind: Kind) -> None:
        future: Future[int] = Future()
        executor = world.executor(node, kind=kind)
        with in_thread(lambda: executor.spin_until_future_complete(future)):
            wait_until(lambda: is_waiting(executor))
            future.set_result(1)
        rclpy.spin_until_future_complete(node, future)

    def test_until_a_future_that_never_is(self, world: World, node: Node) -> None:
        told: list[int] = []
        node.create_timer(0.002, lambda: told.append(1))
        future: Future[int] = Future()
        rclpy.spin_until_future_complete(node, future, timeout_sec=0.05)
        assert told and not future.done()
        executor = world.executor(node)
        executor.spin_once_until_future_complete(future, timeout_sec=0.05)
        executor.spin_once_until_future_complete(future, timeout_sec=0)

    @every_kind
    def test_until_a_future_without_a_wait_makes_the_due_calls(
        self, world: World, node: Node, kind: Kind
    ) -> None:
        """A loop of such calls gets on: each makes one that is due."""
        executor = world.executor(node, kind=kind)
        future: Future[int] = Future()
        told: list[int] = []
        for number in range(3):
            trigger(node, partial(told.append, number), ReentrantCallbackGroup())
        for _ in range(3):
            executor.spin_until_future_complete(future, timeout_sec=0)
        wait_until(lambda: sorted(told) == [0, 1, 2])

    def test_wake_ends_no_spin_once(self, world: World, node: Node) -> None:
        executor, told = world.executor(node), []
        guard = node.create_guard_condition(lambda: told.append(1))
        with in_thread(executor.spin_once):
            wait_until(lambda: is_waiting(executor))
            executor.wake()
            guard.trigger()
        assert told == [1]

    @every_kind
    def test_shutdown_ends_a_spin(self, world: World, node: Node, kind: Kind) -> None:
        executor = world.executor(node, kind=kind)
        with in_thread(executor.spin):
            wait_until(lambda: is_waiting(executor))
            assert executor.shutdown()
        assert executor.is_shutdown and executor.get_nodes() == []
        executor.spin()
        with executor:
            pass

    @every_kind
    def test_shutdown_in_a_callback(self, world: World, node: Node, kind: Kind) -> None:
        executor = world.executor(node, kind=kind)
        told: list[bool] = []
        trigger(node, lambda: told.append(executor.shutdown()))
        executor.spin()
        wait_until(lambda: told)
        assert executor.get_nodes() == []

    def test_shutdown_says_whether_all_calls_have_ended(self, world: World, node: Node) -> None:
        began, gate = threading.Event(), threading.Event()

        def last() -> None:
            began.set()
            gate.wait(WAIT_S)

        executor = world.executor(node, kind=lambda: MultiThreadedExecutor(2))
        trigger(node, last)
        executor.spin_once()
        assert began.wait(WAIT_S)
        assert executor.shutdown(timeout_sec=0.01) is False
        gate.set()
        assert executor.shutdown() is True

    def test_shutdown_waits_for_all_calls(self, world: World, node: Node) -> None:
        """It waits for all of them, not only for the first to end, also if two threads call it."""
        gates = [threading.Event(), threading.Event()]
        ended: list[int] = []
        answers: list[bool] = []

        def last(index: int) -> None:
            gates[index].wait(WAIT_S)
            ended.append(index)

        executor = world.executor(node, kind=lambda: MultiThreadedExecutor(2))
        for index in range(2):
            trigger(node, lambda index=index: last(index), ReentrantCallbackGroup())
            executor.spin_once()

        def shutdown() -> None:
            answers.append(executor.shutdown())

        with in_thread(shutdown), in_thread(shutdown):
            wait_until(lambda: executor.is_shutdown)
            gates[0].set()
            wait_until(lambda: ended == [0])
            threading.Event().wait(0.05)  # time for a wrong answer
            gates[1].set()
        assert answers == [True, True]

    def test_shutdowns_amid_work(self, world: World, node: Node) -> None:
        """An executor with busy threads is shut down: its spin just ends."""
        counts = [0]

        def count() -> None:
            counts[0] += 1

        for _ in range(3):
            node.create_timer(0, count, ReentrantCallbackGroup())
        for _ in range(20):
            with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
                goal = counts[0] + 5
                wait_until(lambda goal=goal: counts[0] >= goal)

    @every_kind
    def test_exceptions_leave_spin(self, world: World, node: Node, kind: Kind) -> None:
        def fail() -> None:
            raise LookupError("in a callback")

        trigger(node, fail)
        executor = world.executor(node, kind=kind)
        with pytest.raises(LookupError, match="in a callback"):
            executor.spin()
        told: list[int] = []
        trigger(node, lambda: told.append(1))
        world.spin_executor_until(lambda: told, executor)

    def test_a_spin_once_in_a_coroutine_of_the_user(self, world: World, node: Node) -> None:
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)

        async def main() -> None:
            publisher = node.create_publisher(Int64, "t", 10)
            publisher.publish(Int64(data=3))
            while not heard:
                rclpy.spin_once(node, timeout_sec=0.05)
                await asyncio.sleep(0)

        asyncio.run(main())
        assert heard == [3]

    def test_the_global_executor(self, world: World, node: Node) -> None:
        executor = rclpy.get_global_executor()
        assert executor is rclpy.get_global_executor()
        own = world.executor()
        trigger(node, lambda: seen.append(node.executor))
        seen: list[Any] = []
        rclpy.spin_once(node, executor=own, timeout_sec=WAIT_S)
        assert seen == [own] and own.get_nodes() == []
        rclpy.shutdown()
        assert executor.is_shutdown


class TestTasks:
    @every_kind
    def test_functions(self, world: World, kind: Kind) -> None:
        executor = world.executor(kind=kind)
        task = executor.create_task(lambda a, b: a - b, 5, b=2)
        executor.spin_until_future_complete(task, timeout_sec=WAIT_S)
        assert task.result() == 3

    @every_kind
    def test_coroutines(self, world: World, kind: Kind) -> None:
        executor = world.executor(kind=kind)
        future: Future[int] = Future()

        async def plus_one() -> int:
            return (await future or 0) + 1

        tasks = [executor.create_task(plus_one), executor.create_task(plus_one())]
        executor.create_task(future.set_result, 1)
        for task in tasks:
            executor.spin_until_future_complete(task, timeout_sec=WAIT_S)
        assert [task.result() for task in tasks] == [2, 2]

    def test_from_another_thread(self, world: World) -> None:
        executor = world.executor()
        with in_thread(executor.spin):
            wait_until(lambda: is_waiting(executor))
            task = executor.create_task(threading.get_ident)
            wait_until(task.done)
            executor.shutdown()
        assert task.result() not in (None, threading.get_ident())

    @every_kind
    def test_one_that_fails_leaves_spin(self, world: World, kind: Kind) -> None:
        executor = world.executor(kind=kind)
        task = executor.create_task(lambda: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            executor.spin()
        with pytest.raises(ZeroDivisionError):
            task.result()

    def test_await_or_execute(self, world: World) -> None:
        async def later(value: int) -> int:
            return value

        async def both() -> list[int]:
            return [await await_or_execute(abs, -1), await await_or_execute(later, 2)]

        executor = world.executor()
        task = executor.create_task(both)
        executor.spin_until_future_complete(task, timeout_sec=WAIT_S)
        assert task.result() == [1, 2]

    def test_waiting_for_a_future_leaves_nothing_behind(self, world: World, node: Node) -> None:
        """A later spin_once has its one call for real work."""
        executor = world.executor(node)
        future: Future[int] = Future(executor=executor)
        for _ in range(3):
            executor.spin_until_future_complete(future, timeout_sec=0)
        trigger(node, lambda: future.set_result(1))
        executor.spin_until_future_complete(future, timeout_sec=WAIT_S)
        told: list[int] = []
        trigger(node, lambda: told.append(1))
        executor.spin_once(timeout_sec=WAIT_S)
        assert told == [1]

    def test_callbacks_of_futures_run_in_the_executor(self, world: World, node: Node) -> None:
        told: list[Any] = []
        executor = world.executor(node)
        future: Future[int] = Future(executor=executor)
        future.add_done_callback(lambda done: told.append(done.result()))
        future.set_result(7)
        assert told == []
        executor.spin_once(timeout_sec=WAIT_S)
        assert told == [7]
