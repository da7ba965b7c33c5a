"""Timers, rates, guard conditions and simulated time in the facade."""

import gc
import threading
import time
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.clock import Clock, ClockType, ROSClock
from bus_ros.rclpy.exceptions import InvalidHandle, ROSInterruptException
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from bus_ros.rclpy.time import Time
from bus_ros.rclpy.timer import TimerInfo
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

LONG_S = 3600
S = 10**9


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


class TestTimers:
    def test_the_first_call_comes_after_one_period(self, world: World, node: Node) -> None:
        calls: list[int] = []
        begin = time.monotonic_ns()
        timer = node.create_timer(0.02, lambda: calls.append(time.monotonic_ns()))
        world.spin_until(lambda: len(calls) == 3)
        for index, call in enumerate(calls):
            assert call - begin >= (index + 1) * 20_000_000
        assert timer.timer_period_ns == 20_000_000

    def test_a_callback_with_an_argument_gets_the_times_of_its_call(self, world: World, node: Node) -> None:
        infos: list[TimerInfo] = []
        timer = node.create_timer(0.005, lambda info: infos.append(info))
        world.spin_until(lambda: len(infos) == 2)
        for info in infos:
            assert info.expected_call_time <= info.actual_call_time <= node.get_clock().now()
            assert info.actual_call_time.clock_type is ClockType.ROS_TIME
        assert infos[0].actual_call_time <= infos[1].actual_call_time

        calls: list[None] = []
        timer.callback = lambda: calls.append(None)  # another signature, from the next call on
        world.spin_until(lambda: len(calls) > 0)

    def test_a_parameter_for_the_times_may_have_a_default_or_need_its_name(
        self, world: World, node: Node
    ) -> None:
        infos: dict[str, TimerInfo | None] = {}

        def last(count: int = 3, info: TimerInfo | None = None, *, times: TimerInfo) -> None:
            assert (count, info) == (3, None)
            infos["last"] = times

        def default(info: TimerInfo = None) -> None:  # type: ignore[assignment]
            infos["default"] = info

        async def named(*, info: TimerInfo) -> None:
            infos["named"] = info

        def other(info: Any = None) -> None:
            infos["other"] = info

        timers = [node.create_timer(0.001, callback) for callback in (last, default, named, other)]
        world.spin_until(lambda: len(infos) == 4)
        assert infos.pop("other") is None
        assert all(isinstance(one, TimerInfo) for one in infos.values())
        assert timers[1].callback is default

    def test_the_times_of_a_simulated_clock(self, world: World, node: Node) -> None:
        clock = ROSClock()
        clock.set_ros_time_override(Time(seconds=10, clock_type=ClockType.ROS_TIME))
        clock._set_ros_time_is_active(True)
        infos: list[TimerInfo] = []
        node.create_timer(2.0, infos.append, clock=clock)
        clock.set_ros_time_override(Time(seconds=13, clock_type=ClockType.ROS_TIME))
        world.spin_until(lambda: len(infos) == 1)
        assert infos[0].expected_call_time == Time(seconds=12, clock_type=ClockType.ROS_TIME)
        assert infos[0].actual_call_time == Time(seconds=13, clock_type=ClockType.ROS_TIME)

    def test_no_burst_after_a_stall(self, world: World, node: Node) -> None:
        """The timer skips missed calls and keeps its phase."""
        period_s, stall_s = 0.005, 0.2
        calls: list[int] = []

        def call() -> None:
            calls.append(time.monotonic_ns())
            if len(calls) == 1:
                time.sleep(stall_s)

        timer = node.create_timer(period_s, call)
        due = timer._next_ns
        world.spin_until(lambda: len(calls) == 10)
        run_s = (calls[-1] - calls[0]) / S - stall_s
        assert len(calls) <= run_s / period_s + 3
        assert (timer._next_ns - due) % timer.timer_period_ns == 0

    def test_cancel_and_reset(self, world: World, node: Node) -> None:
        calls: list[int] = []
        timer = node.create_timer(0.001, lambda: calls.append(1))
        world.spin_until(lambda: calls)
        timer.cancel()
        timer.cancel()
        assert timer.is_canceled() and not timer.is_ready() and timer.time_until_next_call() is None
        count = len(calls)
        others: list[int] = []
        other = node.create_timer(0.001, lambda: others.append(1))
        world.spin_until(lambda: len(others) >= 10)
        assert len(calls) == count
        timer.reset()
        assert not timer.is_canceled()
        world.spin_until(lambda: len(calls) == count + 3)
        assert node.destroy_timer(other)

    def test_one_that_cancels_itself(self, world: World, node: Node) -> None:
        calls: list[str] = []

        def once() -> None:
            calls.append("once")
            timer.cancel()

        timer = node.create_timer(0, once)
        node.create_timer(0.001, lambda: calls.append("other"))
        world.spin_until(lambda: calls.count("other") >= 5)
        assert calls.count("once") == 1

    def test_without_autostart(self, world: World, node: Node) -> None:
        calls: list[int] = []
        timer = node.create_timer(0.001, lambda: calls.append(1), autostart=False)
        assert timer.is_canceled()
        rclpy.spin_once(node, timeout_sec=0.02)
        assert calls == []
        timer.reset()
        world.spin_until(lambda: calls)

    def test_times(self, world: World, node: Node) -> None:
        timer = node.create_timer(LONG_S, print)
        until, since = timer.time_until_next_call(), timer.time_since_last_call()
        assert until is not None and 0 < until <= LONG_S * S and since >= 0
        assert not timer.is_ready()
        due = node.create_timer(0, print)
        assert due.is_ready() and (due.time_until_next_call() or 0) <= 0

    def test_a_new_period(self, world: World, node: Node) -> None:
        """It applies from the next reset on."""
        calls: list[int] = []
        timer = node.create_timer(LONG_S, lambda: calls.append(1))
        timer.timer_period_ns = 1_000_000
        assert timer.timer_period_ns == 1_000_000
        rclpy.spin_once(node, timeout_sec=0.02)
        assert calls == []
        timer.reset()
        world.spin_until(lambda: len(calls) == 3)

    def test_reset_wakes_who_waits(self, world: World, node: Node) -> None:
        calls: list[int] = []
        timer = node.create_timer(LONG_S, lambda: calls.append(1))
        with world.spinning(node) as executor:
            wait_until(lambda: is_waiting(executor))
            timer.timer_period_ns = 0
            timer.reset()
            wait_until(lambda: calls)

    def test_one_made_while_another_thread_spins(self, world: World, node: Node) -> None:
        calls: list[int] = []
        with world.spinning(node) as executor:
            wait_until(lambda: is_waiting(executor))
            node.create_timer(0.001, lambda: calls.append(1))
            wait_until(lambda: len(calls) >= 3)

    def test_period_zero_leaves_others_their_turn(self, world: World, node: Node) -> None:
        calls: list[str] = []
        heard: list[Any] = []
        node.create_timer(0, lambda: calls.append("zero"))
        node.create_timer(0.001, lambda: calls.append("other"))
        node.create_subscription(Int64, "t", heard.append, 100)
        publisher = node.create_publisher(Int64, "t", 100)
        for number in range(20):
            publisher.publish(Int64(data=number))
        world.spin_until(lambda: len(heard) == 20 and calls.count("other") >= 3)
        assert calls.count("zero") >= 3

    def test_two_timers_by_spin_once(self, world: World, node: Node) -> None:
        """Both are due each time; each spin_once calls one of them."""
        calls: list[str] = []
        for name in ("a", "b"):
            node.create_timer(0.001, lambda name=name: calls.append(name))
        for _ in range(40):
            rclpy.spin_once(node, timeout_sec=WAIT_S)
        assert len(calls) == 40
        assert calls[20:].count("a") >= 5 and calls[20:].count("b") >= 5

    def test_a_destroyed_one_is_of_no_use(self, world: World, node: Node) -> None:
        timer = node.create_timer(1, print)
        assert node.destroy_timer(timer) and not node.destroy_timer(timer)
        for use in (timer.cancel, timer.reset, timer.is_ready, timer.is_canceled, timer.time_until_next_call):
            with pytest.raises(InvalidHandle, match="destruction was requested"):
                use()

    def test_async(self, world: World, node: Node) -> None:
        """The next call starts after the end of the one before."""
        calls: list[str] = []
        gate: Future[None] = Future()

        async def call() -> None:
            calls.append("begins")
            if len(calls) == 1:
                await gate
            calls.append("ends")

        node.create_timer(0.001, call)
        others: list[int] = []
        other = world.node("other")
        other.create_timer(0.001, lambda: others.append(1))
        executor = world.executor(node, other)
        world.spin_executor_until(lambda: len(others) >= 10, executor)
        assert calls == ["begins"]
        gate.set_result(None)
        world.spin_executor_until(lambda: len(calls) >= 4, executor)
        assert calls[:4] == ["begins", "ends"] * 2

    def test_one_that_nobody_holds(self, world: World, node: Node) -> None:
        calls: list[int] = []
        node.create_timer(0.001, lambda: calls.append(1))
        gc.collect()
        world.spin_until(lambda: len(calls) == 2)

    def test_one_that_raises(self, world: World, node: Node) -> None:
        def fail() -> None:
            raise OSError("in a timer")

        node.create_timer(0, fail)
        for _ in range(2):
            with pytest.raises(OSError, match="in a timer"):
                rclpy.spin(node)

    @pytest.mark.parametrize("kind", [ClockType.STEADY_TIME, ClockType.SYSTEM_TIME])
    def test_other_clocks(self, world: World, node: Node, kind: ClockType) -> None:
        calls: list[int] = []
        timer = node.create_timer(0.001, lambda: calls.append(1), clock=Clock(clock_type=kind))
        world.spin_until(lambda: len(calls) == 3)
        assert timer.clock.clock_type == kind

    def test_in_worker_threads(self, world: World, node: Node) -> None:
        calls: list[int] = []
        node.create_timer(0.001, lambda: calls.append(threading.get_ident()))
        with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
            wait_until(lambda: len(calls) >= 10)
        assert threading.get_ident() not in calls


class TestRates:
    def test_nobody_need_spin(self, node: Node) -> None:
        begin = time.monotonic_ns()
        rate = node.create_rate(200)
        for _ in range(5):
            rate.sleep()
        assert time.monotonic_ns() - begin >= 4 * 5_000_000

    def test_spin_once_and_sleep_in_one_thread(self, world: World, node: Node) -> None:
        calls: list[int] = []
        node.create_timer(0, lambda: calls.append(1))
        rate = node.create_rate(500)
        for _ in range(5):
            rclpy.spin_once(node, timeout_sec=WAIT_S)
            rate.sleep()
        assert len(calls) == 5

    def test_it_is_a_timer_of_its_node(self, world: World, node: Node) -> None:
        """It is the one call of an executor's spin_once, and wakes the thread that sleeps on the rate."""
        begin_ns = time.monotonic_ns()
        rate = node.create_rate(50)
        assert [timer.timer_period_ns for timer in node.timers] == [20_000_000]
        executor, slept = world.executor(node), []

        def sleep() -> None:
            for _ in range(3):
                rate.sleep()
                slept.append(time.monotonic_ns())

        with in_thread(sleep):
            while len(slept) < 3:
                executor.spin_once()
        assert slept[2] - begin_ns > 50_000_000
        assert node.destroy_rate(rate) and list(node.timers) == []

    def test_one_that_fired_ends_the_next_sleep_at_once(self, world: World, node: Node) -> None:
        rate = node.create_rate(1 / LONG_S)
        rate._timer._next_ns = time.monotonic_ns()
        rclpy.spin_once(node, timeout_sec=WAIT_S)
        rate.sleep()

    def test_all_who_sleep_wake_together(self, world: World, node: Node) -> None:
        rate = node.create_rate(1)
        with in_thread(rate.sleep), in_thread(rate.sleep):
            wait_until(lambda: len(rate._timer.sleepers) == 2)
        assert rate._timer._next_ns - rate._timer._last_ns <= 1_000_000_000

    @every_kind
    def test_in_all_callbacks_that_there_can_be(self, world: World, node: Node, kind: Kind) -> None:
        """Then the executor has no free thread for the timer."""
        slept: list[int] = []
        rate = node.create_rate(200)

        def sleep() -> None:
            rate.sleep()
            slept.append(1)

        for _ in range(3):
            trigger(node, sleep, ReentrantCallbackGroup())
        with world.spinning(node, kind=kind):
            wait_until(lambda: len(slept) == 3)

    def test_shutdown_ends_a_sleep(self, world: World, node: Node) -> None:
        rate = node.create_rate(1 / LONG_S)
        began = threading.Event()

        def sleep() -> None:
            began.set()
            rate.sleep()

        with pytest.raises(ROSInterruptException), in_thread(sleep):
            began.wait()
            rclpy.shutdown()
        with pytest.raises(ROSInterruptException):
            rate.sleep()

    def test_a_destroyed_one(self, node: Node) -> None:
        rate = node.create_rate(1000)
        assert node.destroy_rate(rate) and not node.destroy_rate(rate)
        with pytest.raises(RuntimeError, match="Rate cannot sleep because it has been destroyed"):
            rate.sleep()

    def test_destroying_ends_a_sleep(self, world: World, node: Node) -> None:
        rates = [node.create_rate(1 / LONG_S) for _ in range(2)]
        with in_thread(rates[0].sleep), in_thread(rates[1].sleep):
            wait_until(lambda: all(rate._timer.sleepers for rate in rates))
            node.destroy_rate(rates[0])
            wait_until(lambda: not rates[0]._timer.sleepers)
            node.destroy_node()
        with pytest.raises(InvalidHandle, match="Rate cannot sleep because the timer has been destroyed"):
            rates[1].sleep()


class TestGuardConditions:
    def test_several_triggers_are_one_call(self, world: World, node: Node) -> None:
        calls: list[int] = []
        guard = node.create_guard_condition(lambda: calls.append(1))
        for _ in range(5):
            guard.trigger()
        others: list[int] = []
        world.spin_until(lambda: calls)
        node.create_guard_condition(lambda: others.append(1)).trigger()
        world.spin_until(lambda: others)
        assert calls == [1]

    def test_from_other_threads(self, world: World, node: Node) -> None:
        """A call follows each trigger."""
        calls = [0]
        asked = threading.Semaphore(0)

        def call() -> None:
            calls[0] += 1
            asked.release()

        guard = node.create_guard_condition(call)
        with world.spinning(node):
            for _ in range(200):
                guard.trigger()
                assert asked.acquire(timeout=WAIT_S)
        assert calls == [200]

    def test_async_and_destroyed(self, world: World, node: Node) -> None:
        calls: list[int] = []

        async def call() -> None:
            calls.append(1)

        guard = node.create_guard_condition(call)
        guard.trigger()
        world.spin_until(lambda: calls)
        guard.trigger()
        guard.destroy()
        rclpy.spin_once(node, timeout_sec=0)
        assert calls == [1]
