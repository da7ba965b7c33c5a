"""Callbacks in the facade's executors: nested calls, mutual exclusion, and other work while one runs."""

import threading
from functools import partial
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from conftest import WAIT_S
from rclpy_world import (
    AddTwoInts,
    Int64,
    Kind,
    World,
    add,
    arguments,
    every_kind,
    in_thread,
    trigger,
    wait_until,
    world,
)

__all__ = ["arguments", "world"]


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


class TestCallbacks:
    @every_kind
    def test_they_may_make_and_destroy_things(self, world: World, node: Node, kind: Kind) -> None:
        heard: list[int] = []

        def first() -> None:
            node.destroy_timer(timer)
            node.create_subscription(Int64, "t", second, 10)
            node.create_publisher(Int64, "t", 10).publish(Int64(data=5))

        def second(message: Any) -> None:
            heard.append(message.data)
            other = Node("made_in_a_callback", start_parameter_services=False)
            node.executor.add_node(other)
            trigger(other, lambda: third(other))

        def third(other: Node) -> None:
            other.destroy_node()
            heard.append(6)

        timer = node.create_timer(0, first)
        executor = world.executor(node, kind=kind)
        world.spin_executor_until(lambda: len(heard) == 2, executor)
        assert heard == [5, 6] and executor.get_nodes() == [node]

    @every_kind
    def test_a_node_may_destroy_itself(self, world: World, node: Node, kind: Kind) -> None:
        executor = world.executor(node, kind=kind)
        trigger(node, node.destroy_node)
        world.spin_executor_until(lambda: not executor.get_nodes(), executor)
        wait_until(lambda: node.own_executor is None)

    def test_nested_spinning(self, world: World, node: Node) -> None:
        """With the same executor: the node's other callbacks and the outer spin continue."""
        told: list[str] = []
        node.create_service(AddTwoInts, "add", add)
        client = node.create_client(AddTwoInts, "add")

        def ask() -> None:
            future = client.call_async(AddTwoInts.Request(a=1, b=2))
            rclpy.spin_until_future_complete(node, future, timeout_sec=WAIT_S)
            told.append(f"sum {future.result().sum}")
            guard.trigger()

        def end() -> None:
            told.append("end")
            rclpy.shutdown()

        guard = node.create_guard_condition(end)
        trigger(node, ask)
        rclpy.spin(node)
        assert told == ["sum 3", "end"]

    def test_a_nested_spin_does_not_enter_its_callbacks_again(self, world: World, node: Node) -> None:
        """Neither the callback in which it is, nor the one around that; they come after it."""
        told: list[str] = []
        rounds: list[bool] = []

        def spin(name: str) -> None:
            told.append(f"{name} begins")
            if told.count(f"{name} begins") == 1:
                inner.reset()
                outer.reset()
                executor.spin_until_future_complete(gates[name], timeout_sec=WAIT_S)
            told.append(f"{name} ends")

        def end() -> None:
            rounds.append(outer.is_queued and inner.is_queued)
            if sum(rounds) > 3:  # both have been due again for some rounds
                gates["inner"].set_result(None)
                gates["outer"].set_result(None)

        gates: dict[str, Future[None]] = {"inner": Future(), "outer": Future()}
        outer = node.create_timer(0, lambda: spin("outer"))
        inner = node.create_timer(0, lambda: spin("inner"))
        node.create_timer(0, end, ReentrantCallbackGroup())
        executor = world.executor(node)
        ends = ("outer ends", "inner ends")
        world.spin_executor_until(lambda: all(told.count(end) > 1 for end in ends), executor)
        assert told[:4] == ["outer begins", "inner begins", "inner ends", "outer ends"]

    def test_a_spin_in_another_thread_is_not_nested(self, world: World, node: Node) -> None:
        """It may end after the callback, which may then be called again."""
        began, gate = threading.Event(), threading.Event()
        calls: list[None] = []

        def hold() -> None:
            calls.append(None)
            began.set()
            gate.wait(WAIT_S)

        def until() -> bool:
            gate.set()
            wait_until(lambda: not executor._called)
            return True

        guard = node.create_guard_condition(hold)
        executor: Any
        with world.spinning(node) as executor:
            guard.trigger()
            began.wait(WAIT_S)
            executor._spin_once(0, 1, until)
            assert not executor._called and not guard.is_closed
            guard.trigger()
            wait_until(lambda: len(calls) == 2)

    @pytest.mark.parametrize("last", ["older", "newer"])
    def test_the_end_of_a_call_in_another_thread_lets_no_nested_spin_enter_its_callback_again(
        self, world: World, node: Node, last: str
    ) -> None:
        """Two threads spin; the callback that ends last has spun in it after the end of the other."""
        began = {"older": threading.Event(), "newer": threading.Event()}
        ended = threading.Event()
        told: list[str] = []

        def call(name: str) -> None:
            told.append(name)
            began[name].set()
            if told.count(name) > 1:
                return
            began["newer"].wait(WAIT_S)
            if name == last:
                ended.wait(WAIT_S)
                guards[name].trigger()
                executor.spin_once(timeout_sec=0)
                told.append("spun")

        def spin_once() -> None:
            executor.spin_once(timeout_sec=WAIT_S)
            ended.set()

        guards = {
            name: node.create_guard_condition(partial(call, name), MutuallyExclusiveCallbackGroup())
            for name in began
        }
        executor = world.executor(node)
        guards["older"].trigger()
        with in_thread(spin_once):
            began["older"].wait(WAIT_S)
            guards["newer"].trigger()
            spin_once()
        executor.spin_once(timeout_sec=0)
        assert told == ["older", "newer", "spun", last]

    def test_a_nested_spin_in_a_reentrant_group_enters_it_again(self, world: World, node: Node) -> None:
        depth: list[int] = []

        def spin() -> None:
            depth.append(len(depth))
            if len(depth) < 3:
                world.spin_executor_until(lambda: len(depth) == 3, executor)

        node.create_timer(0, spin, ReentrantCallbackGroup())
        executor = world.executor(node)
        world.spin_executor_until(lambda: depth, executor)
        assert depth[:3] == [0, 1, 2]

    @every_kind
    def test_calls_of_services_in_a_callback(self, world: World, node: Node, kind: Kind) -> None:
        told: list[int] = []
        server = world.node("server")
        server.create_service(AddTwoInts, "add", add)
        client = node.create_client(AddTwoInts, "add")

        def ask() -> None:
            assert client.wait_for_service(timeout_sec=WAIT_S)
            told.append(client.call(AddTwoInts.Request(a=1, b=2), timeout_sec=WAIT_S).sum)

        trigger(node, ask)
        with world.spinning(server):
            world.spin_executor_until(lambda: told, world.executor(node, kind=kind))
        assert told == [3]

    def test_a_call_of_a_service_of_its_own_needs_a_second_thread(self, world: World, node: Node) -> None:
        told: list[int] = []
        node.create_service(AddTwoInts, "add", add, callback_group=ReentrantCallbackGroup())
        client = node.create_client(AddTwoInts, "add")
        trigger(node, lambda: told.append(client.call(AddTwoInts.Request(a=1, b=2)).sum))
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
            wait_until(lambda: told)
        assert told == [3]

    @every_kind
    def test_async_callbacks_of_one_group_exclude_each_other(
        self, world: World, node: Node, kind: Kind
    ) -> None:
        """While an async callback awaits, it holds its group; callbacks of another group continue."""
        told: list[str] = []
        gate: Future[None] = Future()

        async def first() -> None:
            told.append("first begins")
            await gate
            told.append("first ends")

        trigger(node, first)
        executor = world.executor(node, kind=kind)
        world.spin_executor_until(lambda: told, executor)
        trigger(node, lambda: told.append("second"))
        trigger(node, lambda: told.append("free"), ReentrantCallbackGroup())
        world.spin_executor_until(lambda: len(told) == 2, executor)
        executor.spin_once(timeout_sec=0)
        assert told == ["first begins", "free"]
        gate.set_result(None)
        world.spin_executor_until(lambda: len(told) == 4, executor)
        assert told == ["first begins", "free", "first ends", "second"]


class TestGroups:
    def test_exclusive_callbacks_never_meet(self, world: World, node: Node) -> None:
        group = MutuallyExclusiveCallbackGroup()
        inside = threading.Lock()
        counts, meetings = [0] * 4, []

        def work(index: int) -> None:
            if not inside.acquire(blocking=False):
                meetings.append(index)
                return
            counts[index] += 1
            inside.release()

        for index in range(4):
            node.create_timer(0.0005, lambda index=index: work(index), group)
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(4)):
            wait_until(lambda: min(counts) >= 50)
        assert meetings == []

    @pytest.mark.parametrize("how", ["reentrant", "two groups"])
    def test_others_run_at_once(self, world: World, node: Node, how: str) -> None:
        """Two callbacks each wait for the other."""
        meeting = threading.Barrier(2)
        one = ReentrantCallbackGroup()
        groups = (
            [one, one]
            if how == "reentrant"
            else [MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()]
        )
        met: list[int] = []
        for group in groups:
            trigger(node, lambda: met.append(meeting.wait(WAIT_S)), group)
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
            wait_until(lambda: len(met) == 2)

    def test_one_subscription_in_several_threads(self, world: World, node: Node) -> None:
        meeting = threading.Barrier(3)
        met: list[int] = []
        group = ReentrantCallbackGroup()
        node.create_subscription(
            Int64, "t", lambda message: met.append(meeting.wait(WAIT_S)), 10, callback_group=group
        )
        publisher = node.create_publisher(Int64, "t", 10)
        for _ in range(3):
            publisher.publish(Int64())
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(3)):
            wait_until(lambda: len(met) == 3)

    def test_a_group_that_two_executors_share(self, world: World) -> None:
        group = MutuallyExclusiveCallbackGroup()
        inside = threading.Lock()
        nodes = [world.node(f"n{index}") for index in range(2)]
        counts, meetings = [0, 0], []

        def work(index: int) -> None:
            if not inside.acquire(blocking=False):
                meetings.append(index)
                return
            counts[index] += 1
            inside.release()

        for index, node in enumerate(nodes):
            node.create_timer(0.0005, lambda index=index: work(index), group)
        pair = [lambda: MultiThreadedExecutor(2)] * 2
        with world.spinning(nodes[0], kind=pair[0]), world.spinning(nodes[1], kind=pair[1]):
            wait_until(lambda: min(counts) >= 50)
        assert meetings == []

    def test_no_more_at_once_than_threads(self, world: World, node: Node) -> None:
        group = ReentrantCallbackGroup()
        lock, inside, most, count = threading.Lock(), [0], [0], [0]

        def work() -> None:
            with lock:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
            threading.Event().wait(0.0005)
            with lock:
                inside[0] -= 1
                count[0] += 1

        for _ in range(6):
            node.create_timer(0, work, group)
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
            wait_until(lambda: count[0] >= 200)
        assert most[0] == 2

    def test_threads_by_default_and_one_alone(self, world: World, monkeypatch: pytest.MonkeyPatch) -> None:
        """The default number of threads is the number of CPUs that the process may use."""
        text = "Use the SingleThreadedExecutor instead"
        with pytest.warns(UserWarning, match=text):
            world.executor(kind=lambda: MultiThreadedExecutor(1))
        monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
        world.executor(kind=MultiThreadedExecutor)
        monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})
        with pytest.warns(UserWarning, match=text):
            world.executor(kind=MultiThreadedExecutor)


class TestLongCallbacks:
    """The rest of the process continues during a callback, although only one thread spins."""

    def test_a_service_is_found(self, world: World, node: Node) -> None:
        client = node.create_client(AddTwoInts, "add")
        began, found = threading.Event(), []

        def wait() -> None:
            began.set()
            found.append(client.wait_for_service(timeout_sec=WAIT_S))

        trigger(node, wait)
        with in_thread(lambda: rclpy.spin_once(node)):
            began.wait(WAIT_S)
            world.node("server").create_service(AddTwoInts, "add", add)
        assert found == [True]

    def test_matches_come_and_go(self, world: World, node: Node) -> None:
        """Without a call in the callback that would run the loop."""
        publisher = node.create_publisher(Int64, "t", 10)
        counts: list[int] = []
        began = threading.Event()

        def watch() -> None:
            began.set()
            wait_until(lambda: publisher.get_subscription_count() == 1)
            counts.append(publisher.get_subscription_count())

        trigger(node, watch)
        with in_thread(lambda: rclpy.spin_once(node)):
            began.wait(WAIT_S)
            world.node("other").create_subscription(Int64, "t", print, 10)
        assert counts == [1]

    def test_queues_fill_and_what_is_published_leaves(self, world: World, node: Node) -> None:
        heard: list[int] = []
        other_heard: list[int] = []
        other = world.node("other")
        node.create_subscription(Int64, "in", lambda message: heard.append(message.data), 10)
        other.create_subscription(Int64, "out", lambda message: other_heard.append(message.data), 10)
        into = other.create_publisher(Int64, "in", 10)
        out = node.create_publisher(Int64, "out", 10)

        def last() -> None:
            out.publish(Int64(data=1))
            wait_until(lambda: other_heard)
            for number in range(5):
                into.publish(Int64(data=number))

        trigger(node, last)
        with world.spinning(other):
            rclpy.spin_once(node, timeout_sec=WAIT_S)
            assert heard == []
            world.spin_until(lambda: len(heard) == 5, node)
        assert (heard, other_heard) == ([0, 1, 2, 3, 4], [1])

    def test_a_node_that_is_made_and_one_that_goes(self, world: World, node: Node) -> None:
        seen: list[list[str]] = []

        def look() -> None:
            with Node("passing", start_parameter_services=False):
                seen.append(sorted(node.get_node_names()))
            wait_until(lambda: node.get_node_names() == ["tester"])

        trigger(node, look)
        rclpy.spin_once(node, timeout_sec=WAIT_S)
        assert seen == [["passing", "tester"]]
