"""Clocks, their jumps, and sleeping by them.

Owns the three clocks, the callbacks for jumps, and `ClockEvent`, on which threads wait. Must not know the
source of simulated time: that is `bus_ros.rclpy.time_source`.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum, IntEnum
from types import TracebackType
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary, ref

from bus_ros.rclpy.destroyable import Handled
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import NotInitializedException
from bus_ros.rclpy.time import ClockType, Time

if TYPE_CHECKING:
    from bus_ros.rclpy.context import Context

__all__ = [
    "ANY_JUMP",
    "CHANGES_OF_SOURCE",
    "BaseClock",
    "Clock",
    "ClockChange",
    "ClockEvent",
    "ClockType",
    "JumpHandle",
    "JumpThreshold",
    "OverridableClock",
    "ROSClock",
    "TimeJump",
]

_LONGEST_WAIT_S = 1.0
"""After this time a wait reads the clock again: the machine's date may have been set."""


class ClockChange(IntEnum):
    """Whether a jump also began or ended simulated time. As text: `ClockChange.ROS_TIME_ACTIVATED`, ..."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4

    __str__ = Enum.__str__  # as rclpy prints the change of a jump
    __format__ = Enum.__format__


class JumpThreshold:
    """The kinds of jumps for which a callback is called.

    `min_forward` is a positive Duration, `min_backward` a negative one; None: no call for such jumps.
    `on_clock_change`: also if simulated time begins or ends. Raises ValueError for a wrong sign, or without
    any of them.
    """

    def __init__(
        self, *, min_forward: Duration | None, min_backward: Duration | None, on_clock_change: bool = True
    ) -> None:
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if min_forward is None and min_backward is None and not on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")
        self.min_forward = min_forward
        self.min_backward = min_backward
        self.on_clock_change = on_clock_change

    def is_exceeded(self, jump: "TimeJump") -> bool:
        """Whether a callback with this threshold is called for that jump."""
        if jump.clock_change in CHANGES_OF_SOURCE:
            return self.on_clock_change
        if self.min_forward is not None and jump.delta >= self.min_forward:
            return True
        return self.min_backward is not None and jump.delta <= self.min_backward


class TimeJump:
    """A jump, as callbacks get it: the change of the clock, and the distance."""

    def __init__(self, clock_change: ClockChange, delta: Duration) -> None:
        if not isinstance(clock_change, ClockChange):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")
        self._clock_change = clock_change
        self._delta = delta

    @property
    def clock_change(self) -> ClockChange:
        return self._clock_change

    @property
    def delta(self) -> Duration:
        return self._delta


class JumpHandle:
    """A registration of callbacks for jumps, until `unregister` or the end of a `with` block."""

    def __init__(
        self,
        *,
        clock: "BaseClock",
        threshold: JumpThreshold,
        pre_callback: Callable[[], object] | None,
        post_callback: Callable[[TimeJump], object] | None,
    ) -> None:
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        if pre_callback is not None and not callable(pre_callback):
            raise ValueError("pre_callback must be callable if given")
        if post_callback is not None and not callable(post_callback):
            raise ValueError("post_callback must be callable if given")
        self.threshold = threshold
        self.pre_callback = pre_callback
        self.post_callback = post_callback
        self._clock: BaseClock | None = clock
        clock._jump_handles.append(self)

    def unregister(self) -> None:
        """Stop the calls; may be repeated."""
        clock, self._clock = self._clock, None
        if clock is not None:
            clock._jump_handles.remove(self)

    def __enter__(self) -> "JumpHandle":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unregister()


class ClockEvent:
    """A wait of threads until a clock shows a time, or another thread calls `set`."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._is_set = False

    def set(self) -> None:
        with self._changed:
            self._is_set = True
            self._changed.notify_all()

    def clear(self) -> None:
        with self._changed:
            self._is_set = False

    def is_set(self) -> bool:
        return self._is_set

    def recheck(self) -> None:
        """Make waiting threads compare again: the clock has moved."""
        with self._changed:
            self._changed.notify_all()

    def wait_until(self, clock: "BaseClock", until: Time) -> None:
        """Wait until `clock` shows `until`, or until `set`. Changes of simulated time need `recheck`."""
        with self._changed:
            while not self._is_set:
                left_s = (until.nanoseconds - clock.now().nanoseconds) / 1e9
                if left_s <= 0:
                    return
                self._changed.wait(
                    _LONGEST_WAIT_S if clock.ros_time_is_active else min(left_s, _LONGEST_WAIT_S)
                )

    wait_until_steady = wait_until_system = wait_until_ros = wait_until


class BaseClock(Handled):
    """Base of all clocks: a clock of one type, and its jumps."""

    is_destroyed = False  # always
    _clock_type: ClockType
    _jump_handles: list[JumpHandle]

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> "BaseClock":
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        self = super().__new__(cls)
        self._clock_type = clock_type
        self._jump_handles = []
        return self

    def destroy(self) -> None:
        """Does nothing: a clock lives as long as it is used."""

    @property
    def clock_type(self) -> ClockType:
        return self._clock_type

    @property
    def ros_time_is_active(self) -> bool:
        """Whether the time comes from a simulation at the moment."""
        return False

    def __repr__(self) -> str:
        return f"Clock(clock_type={self._clock_type.name})"

    def now(self) -> Time:
        """The time that the clock shows."""
        ns = time.monotonic_ns() if self._clock_type is ClockType.STEADY_TIME else time.time_ns()
        return Time.of_clock(ns, self._clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: Callable[[], object] | None = None,
        post_callback: Callable[[TimeJump], object] | None = None,
    ) -> JumpHandle:
        """Call `pre_callback()` before and `post_callback(jump)` after each jump of the threshold's kind.

        They are called in the thread that sets the time and must not block. Raises ValueError without any
        callback.
        """
        return JumpHandle(
            clock=self, threshold=threshold, pre_callback=pre_callback, post_callback=post_callback
        )


class Clock(BaseClock):
    """A clock by which threads can sleep; `Clock(clock_type=ClockType.ROS_TIME)` is a ROSClock."""

    def __new__(cls, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> "Clock":
        made = ROSClock if clock_type is ClockType.ROS_TIME else cls
        self = BaseClock.__new__(made, clock_type=clock_type)
        assert isinstance(self, Clock)
        return self

    def sleep_until(self, until: Time, context: "Context | None" = None) -> bool:
        """Block until the clock shows `until`.

        Returns False if the context was shut down meanwhile, or simulated time began or ended. Raises
        ValueError for the time of another clock, NotInitializedException if the context is not initialized.
        """
        if context is None:
            from bus_ros.rclpy.utilities import get_default_context

            context = get_default_context()
        if not context.ok():
            raise NotInitializedException
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")

        event = ClockEvent()

        def on_jump(jump: TimeJump) -> None:
            if jump.clock_change in CHANGES_OF_SOURCE:
                event.set()
            else:
                event.recheck()

        with _woken_by(context, event), self.create_jump_callback(ANY_JUMP, post_callback=on_jump):
            if context.ok():  # the shutdown may have come before `_woken_by`
                event.wait_until(self, until)
        return context.ok() and not event.is_set()

    def sleep_for(self, rel_time: Duration, context: "Context | None" = None) -> bool:
        """Block for a duration by this clock; errors as for `sleep_until`."""
        return self.sleep_until(self.now() + rel_time, context)


class OverridableClock(BaseClock):
    """The machine's time, or the simulation's while `ros_time_is_active`."""

    _is_active = False
    _override_ns = 0

    @property
    def ros_time_is_active(self) -> bool:
        """Whether `set_ros_time_override` sets the time."""
        return self._is_active

    def now(self) -> Time:
        if self._is_active:
            return Time.of_clock(self._override_ns, ClockType.ROS_TIME)
        return Time.of_clock(time.time_ns(), ClockType.ROS_TIME)

    def set_ros_time_override(self, time: Time) -> None:
        """Set the simulation's time; the clock shows it while simulated time is active."""
        if not isinstance(time, Time):
            raise TypeError(f"Time must be specified as rclpy.time.Time. Received type: {type(time)}")
        if not self._is_active:
            self._override_ns = time.nanoseconds
            return
        delta = Duration(nanoseconds=time.nanoseconds - self._override_ns)
        with self._jumping(TimeJump(ClockChange.ROS_TIME_NO_CHANGE, delta)):
            self._override_ns = time.nanoseconds

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        """For the time source that manages this clock."""
        if enabled == self._is_active:
            return
        change = ClockChange.ROS_TIME_ACTIVATED if enabled else ClockChange.ROS_TIME_DEACTIVATED
        with self._jumping(TimeJump(change, Duration())):
            self._is_active = enabled

    @contextmanager
    def _jumping(self, jump: TimeJump) -> Iterator[None]:
        """Call the callbacks before and after the body, which moves the clock."""
        concerned = [handle for handle in self._jump_handles[:] if handle.threshold.is_exceeded(jump)]
        for handle in concerned:
            if handle.pre_callback is not None:
                handle.pre_callback()
        yield
        for handle in concerned:
            if handle.post_callback is not None:
                handle.post_callback(jump)


class ROSClock(OverridableClock, Clock):
    """The clock of a node."""

    def __new__(cls) -> "ROSClock":
        self = BaseClock.__new__(cls, clock_type=ClockType.ROS_TIME)
        assert isinstance(self, ROSClock)
        return self


# For each context, the waits that its end wakes: a context has no method to remove a callback.
_sleepers: WeakKeyDictionary["Context", set[ClockEvent]] = WeakKeyDictionary()
_sleepers_lock = threading.Lock()


@contextmanager
def _woken_by(context: "Context", event: ClockEvent) -> Iterator[None]:
    """During the body, the end of the context sets the event."""
    with _sleepers_lock:
        sleepers = _sleepers.get(context)
        is_new = sleepers is None
        if sleepers is None:
            sleepers = _sleepers[context] = set()
        sleepers.add(event)
    if is_new:
        of_context = ref(context)
        context.on_shutdown(lambda: _wake_sleepers(of_context()))
    try:
        yield
    finally:
        with _sleepers_lock:
            sleepers.discard(event)


def _wake_sleepers(context: "Context | None") -> None:
    with _sleepers_lock:
        # The context may be initialized again, and then has no callbacks.
        woken = tuple(_sleepers.pop(context, ())) if context is not None else ()
    for event in woken:
        event.set()


CHANGES_OF_SOURCE = (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)
ANY_JUMP = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=Duration(nanoseconds=-1))
