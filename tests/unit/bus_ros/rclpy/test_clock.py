"""Clocks of the facade: time, jumps, sleeping and its end, and simulated time."""

import signal
import sys
import threading
import time
from collections.abc import Callable
from types import CodeType, SimpleNamespace
from typing import Any

import pytest

from bus_ros.rclpy import clock as clocks
from bus_ros.rclpy.clock import Clock, ClockChange, ClockEvent, ClockType, JumpThreshold, ROSClock, TimeJump
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import NotInitializedException
from bus_ros.rclpy.time import Time
from bus_ros.rclpy.time_source import TimeSource
from bus_ros.rosidl import message_class

LONG = Duration(seconds=3600)
WAIT_S = 60.0


class Context:
    """The part of a context that a clock uses."""

    def __init__(self) -> None:
        self.is_ok = True
        self.callbacks: list[Callable[[], object]] = []

    def ok(self) -> bool:
        return self.is_ok

    def on_shutdown(self, callback: Callable[[], object]) -> None:
        self.callbacks.append(callback)

    def shutdown(self) -> None:
        self.is_ok = False
        callbacks, self.callbacks = self.callbacks, []
        for callback in callbacks:
            callback()


class Sleeper:
    """A thread that sleeps by a clock. `act` runs once it sleeps."""

    def __init__(self, clock: Clock, span: Duration, context: Context) -> None:
        self.result: bool | None = None
        self._context = context
        self._thread = threading.Thread(target=self._sleep, args=(clock, span))
        sleepers = len(clock._jump_handles)
        self._thread.start()
        while len(clock._jump_handles) == sleepers:  # its last step before the wait
            time.sleep(0.001)

    def _sleep(self, clock: Clock, span: Duration) -> None:
        self.result = clock.sleep_for(span, self._context)  # type: ignore[arg-type]

    def end(self) -> bool | None:
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()
        return self.result


def is_in(thread: int, code: CodeType) -> bool:
    """True if the thread is within that function now."""
    frame = sys._current_frames().get(thread)
    while frame is not None and frame.f_code is not code:
        frame = frame.f_back
    return frame is not None


def ros_clock(seconds: float = 10) -> ROSClock:
    clock = ROSClock()
    clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
    clock._set_ros_time_is_active(True)
    return clock


def at(seconds: float) -> Time:
    return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)


def test_clocks_show_their_time() -> None:
    before = time.time_ns()
    shown = Clock().now()
    assert before <= shown.nanoseconds <= time.time_ns()
    assert shown.clock_type is ClockType.SYSTEM_TIME
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    before = time.monotonic_ns()
    assert before <= steady.now().nanoseconds <= time.monotonic_ns()
    assert repr(steady) == "Clock(clock_type=STEADY_TIME)"


def test_a_clock_of_ros_time_is_a_ros_clock() -> None:
    assert type(Clock(clock_type=ClockType.ROS_TIME)) is ROSClock
    assert ROSClock().clock_type is ClockType.ROS_TIME
    assert not ROSClock().ros_time_is_active
    with pytest.raises(TypeError, match="Clock type must be a ClockType enum"):
        Clock(clock_type=1)  # type: ignore[arg-type]


def test_simulated_time_shows_while_it_is_active() -> None:
    clock = ROSClock()
    clock.set_ros_time_override(at(5))
    assert clock.now() > at(1_000_000_000)
    clock._set_ros_time_is_active(True)
    assert clock.now() == at(5)
    clock.set_ros_time_override(at(4))
    assert clock.now() == at(4)
    with pytest.raises(TypeError, match=r"Time must be specified as rclpy.time.Time"):
        clock.set_ros_time_override(5)  # type: ignore[arg-type]


def test_jumps_reach_who_asked_for_them() -> None:
    clock = ros_clock(10)
    heard: list[str] = []

    def listen(name: str, **threshold: Any) -> clocks.JumpHandle:
        defaults = {"min_forward": None, "min_backward": None, "on_clock_change": False}
        return clock.create_jump_callback(
            JumpThreshold(**(defaults | threshold)),
            pre_callback=lambda: heard.append(f"before {name} {clock.now().nanoseconds}"),
            post_callback=lambda jump: heard.append(
                f"{name} {jump.clock_change.name} {jump.delta.nanoseconds}"
            ),
        )

    forward = listen("forward", min_forward=Duration(nanoseconds=5))
    with listen("backward", min_backward=Duration(nanoseconds=-5)), listen("change", on_clock_change=True):
        clock.set_ros_time_override(at(10) + Duration(nanoseconds=4))
        assert heard == []
        clock.set_ros_time_override(at(10) + Duration(nanoseconds=9))
        clock.set_ros_time_override(at(10))
        clock._set_ros_time_is_active(False)
    forward.unregister()
    forward.unregister()
    clock._set_ros_time_is_active(True)
    assert heard == [
        "before forward 10000000004",
        "forward ROS_TIME_NO_CHANGE 5",
        "before backward 10000000009",
        "backward ROS_TIME_NO_CHANGE -9",
        "before change 10000000000",
        "change ROS_TIME_DEACTIVATED 0",
    ]


def test_a_change_of_a_clock_as_text() -> None:
    assert str(ClockChange.ROS_TIME_ACTIVATED) == "ClockChange.ROS_TIME_ACTIVATED"
    assert f"{ClockChange.ROS_TIME_NO_CHANGE}" == "ClockChange.ROS_TIME_NO_CHANGE"


def test_thresholds_and_callbacks_that_make_no_sense() -> None:
    with pytest.raises(ValueError, match="min_forward must be a positive non-zero duration"):
        JumpThreshold(min_forward=Duration(), min_backward=None)
    with pytest.raises(ValueError, match="min_backward must be a negative non-zero duration"):
        JumpThreshold(min_forward=None, min_backward=Duration())
    with pytest.raises(ValueError, match="At least one jump threshold must be enabled"):
        JumpThreshold(min_forward=None, min_backward=None, on_clock_change=False)
    threshold = JumpThreshold(min_forward=None, min_backward=None)
    with pytest.raises(ValueError, match="One of pre_callback or post_callback must be callable"):
        Clock().create_jump_callback(threshold)
    with pytest.raises(ValueError, match="post_callback must be callable if given"):
        Clock().create_jump_callback(threshold, post_callback=1)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="clock_change must be an instance"):
        TimeJump(1, Duration())  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", list(ClockType)[1:])
def test_sleep_lasts_as_long_as_it_should(kind: ClockType) -> None:
    clock = Clock(clock_type=kind)
    end = clock.now() + Duration(seconds=0.02)
    assert clock.sleep_until(end, Context())  # type: ignore[arg-type]
    assert clock.now() >= end
    assert clock.sleep_until(end, Context())  # type: ignore[arg-type]


def test_shutdown_ends_a_sleep_and_leaves_nothing() -> None:
    context = Context()
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    first, second = Sleeper(clock, LONG, context), Sleeper(clock, LONG, context)
    context.shutdown()
    assert first.end() is second.end() is False
    assert clock._jump_handles == []
    assert context not in clocks._sleepers
    with pytest.raises(NotInitializedException):
        clock.sleep_for(LONG, context)  # type: ignore[arg-type]


def test_many_sleeps_are_one_callback_of_the_context() -> None:
    context = Context()
    for _ in range(5):
        Clock().sleep_for(Duration(nanoseconds=1), context)  # type: ignore[arg-type]
    assert len(context.callbacks) == 1


def test_keyboard_interrupt_ends_a_sleep() -> None:
    clock = Clock()
    main = threading.main_thread().ident
    assert main is not None

    def interrupt() -> None:
        while not is_in(main, ClockEvent.wait_until.__code__):
            time.sleep(0.001)
        signal.pthread_kill(main, signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            clock.sleep_for(LONG, Context())  # type: ignore[arg-type]
    finally:
        signal.signal(signal.SIGINT, before)
        thread.join(WAIT_S)
    assert clock._jump_handles == []


def test_simulated_time_ends_a_sleep() -> None:
    clock = ros_clock(10)
    sleeper = Sleeper(clock, Duration(seconds=5), Context())
    clock.set_ros_time_override(at(14))
    assert sleeper.result is None
    clock.set_ros_time_override(at(15))
    assert sleeper.end() is True


def test_a_change_of_the_source_ends_a_sleep() -> None:
    clock = ros_clock(10)
    sleeper = Sleeper(clock, LONG, Context())
    clock._set_ros_time_is_active(False)
    assert sleeper.end() is False


def test_sleep_by_another_clock_s_time() -> None:
    with pytest.raises(ValueError, match="until's clock type does not match this clock's type"):
        Clock().sleep_until(at(1), Context())  # type: ignore[arg-type]


class Node:
    """The part of a node that a time source uses."""

    def __init__(self, use_sim_time: object = None) -> None:
        self.parameters: dict[str, object] = {} if use_sim_time is None else {"use_sim_time": use_sim_time}
        self.topics: list[str] = []
        self.errors: list[str] = []
        self.callbacks: list[Callable[[list[Any]], None]] = []

    def has_parameter(self, name: str) -> bool:
        return name in self.parameters

    def declare_parameter(self, name: str, value: object) -> None:
        self.parameters[name] = value

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(name=name, value=self.parameters[name])

    def add_post_set_parameters_callback(self, callback: Callable[[list[Any]], None]) -> None:
        self.callbacks.append(callback)

    def remove_post_set_parameters_callback(self, callback: Callable[[list[Any]], None]) -> None:
        self.callbacks.remove(callback)

    def create_subscription(
        self, msg_type: type, topic: str, callback: object, qos: object, **_: object
    ) -> str:
        self.topics.append(topic)
        return topic

    def destroy_subscription(self, subscription: str) -> None:
        self.topics.remove(subscription)

    def get_logger(self) -> Any:
        return SimpleNamespace(error=self.errors.append)

    def set(self, value: object) -> None:
        for callback in self.callbacks:
            callback([SimpleNamespace(name="use_sim_time", value=value)])


@pytest.fixture(autouse=True)
def nodes_are_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bus_ros.rclpy.node", SimpleNamespace(Node=Node))


def clock_message(seconds: int) -> Any:
    return message_class("rosgraph_msgs/msg/Clock")(clock=at(seconds).to_msg())  # type: ignore[call-arg]


def test_a_time_source_follows_the_parameter() -> None:
    node, clock = Node(), ROSClock()
    source = TimeSource(node=node)  # type: ignore[arg-type]
    source.attach_clock(clock)
    assert node.parameters == {"use_sim_time": False}
    assert (source.ros_time_is_active, node.topics) == (False, [])
    node.set(True)
    node.set(True)
    assert (clock.ros_time_is_active, node.topics) == (True, ["/clock"])
    source.clock_callback(clock_message(42))
    assert clock.now() == at(42)
    later = ROSClock()
    source.attach_clock(later)
    assert later.now() == at(42)
    node.set(False)
    assert (clock.ros_time_is_active, node.topics) == (False, [])


def test_a_node_that_begins_with_simulated_time() -> None:
    node, clock = Node(use_sim_time=True), ROSClock()
    source = TimeSource()
    source.attach_clock(clock)
    source.attach_node(node)  # type: ignore[arg-type]
    assert (clock.ros_time_is_active, node.topics) == (True, ["/clock"])
    source.detach_node()
    assert (node.topics, node.callbacks) == ([], [])


def test_what_a_time_source_refuses() -> None:
    node = Node(use_sim_time="yes")
    source = TimeSource(node=node)  # type: ignore[arg-type]
    assert node.errors == ["Invalid type for parameter 'use_sim_time' str should be bool"]
    with pytest.raises(ValueError, match=r"Only clocks with type ROS_TIME can be attached."):
        source.attach_clock(Clock())
    with pytest.raises(TypeError, match="Clock must be of type"):
        source.attach_clock(1)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="Node must be of type"):
        source.attach_node(1)  # type: ignore[arg-type]
