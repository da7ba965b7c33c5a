"""Timers and rates. A timer keeps its phase and skips missed calls, as in ROS 2 (rcl/timer.c)."""

import inspect
from collections.abc import Callable
from time import monotonic_ns
from types import FunctionType

from bus.base.callbacks import is_async, takes
from bus_ros.engine import Engine, Lifetime, Waiter, engine
from bus_ros.entity import Entity, Group, Owner, Work
from bus_ros.rclpy.clock import (
    ANY_JUMP,
    CHANGES_OF_SOURCE,
    BaseClock,
    Clock,
    JumpHandle,
    OverridableClock,
    TimeJump,
)
from bus_ros.rclpy.destroyable import Handled
from bus_ros.rclpy.exceptions import InvalidHandle, ROSInterruptException
from bus_ros.rclpy.time import ClockType, Time

__all__ = ["BaseTimer", "Rate", "Timer", "TimerInfo"]

NEVER_NS = 1 << 62
_GRACE_NS = 10_000_000
"""For this time, the sleepers of a rate leave its timer to an executor that waits for it."""


def _now_ns(clock: BaseClock) -> int:
    """The clock's time, or the monotonic time if it is not simulated: a new date must not stall a timer."""
    return clock.now().nanoseconds if clock.ros_time_is_active else monotonic_ns()


class TimerInfo:
    """The times of one call of a timer, as its callback gets them if it takes an argument."""

    def __init__(self, *, expected_call_time: int, actual_call_time: int, clock_type: ClockType) -> None:
        self._expected = Time(nanoseconds=expected_call_time, clock_type=clock_type)
        self._actual = Time(nanoseconds=actual_call_time, clock_type=clock_type)

    @property
    def expected_call_time(self) -> Time:
        """When the call was due."""
        return self._expected

    @property
    def actual_call_time(self) -> Time:
        """When it was made."""
        return self._actual


class BaseTimer(Handled):
    """The times of the calls of a timer: one each `timer_period_ns`, first after one period."""

    is_destroyed: bool

    def __init__(self, timer_period_ns: int, clock: BaseClock, *, autostart: bool) -> None:
        self.clock = clock
        self.is_simulated = clock.ros_time_is_active
        self._period_ns = timer_period_ns
        self._last_ns = self._now_ns()
        self._next_ns = self._last_ns + timer_period_ns
        self._is_canceled = not autostart
        self._left_ns = timer_period_ns
        self._jumps: JumpHandle | None = None
        if isinstance(clock, OverridableClock):
            self._jumps = clock.create_jump_callback(
                ANY_JUMP, pre_callback=self._before, post_callback=self._after
            )

    @property
    def timer_period_ns(self) -> int:
        """Setting it takes effect at the next `reset` or call."""
        return self._period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        self._period_ns = int(value)

    # These raise InvalidHandle if the timer is destroyed.

    def cancel(self) -> None:
        """Stop the calls, until `reset`."""
        self._check()
        self._is_canceled = True

    def reset(self) -> None:
        """Restart the period: the next call comes one period from now."""
        self._check()
        self._is_canceled = False
        self._next_ns = self._now_ns() + self._period_ns
        self._times_changed()

    def is_canceled(self) -> bool:
        self._check()
        return self._is_canceled

    def is_ready(self) -> bool:
        """Whether a call is due."""
        self._check()
        return not self._is_canceled and self._now_ns() >= self._next_ns

    def time_since_last_call(self) -> int:
        """In nanoseconds."""
        self._check()
        return self._now_ns() - self._last_ns

    def time_until_next_call(self) -> int | None:
        """In nanoseconds, negative if it is late; None if it is canceled."""
        self._check()
        return None if self._is_canceled else self._next_ns - self._now_ns()

    def forget_clock(self) -> None:
        """Leave the clock: the timer is destroyed."""
        if self._jumps is not None:
            self._jumps.unregister()

    # --- at a jump of the clock (rcl/timer.c, _rcl_timer_time_jump)

    def _before(self) -> None:
        self._left_ns = self._next_ns - self._now_ns()

    def _after(self, jump: TimeJump) -> None:
        self.is_simulated = self.clock.ros_time_is_active
        now_ns = self._now_ns()
        if jump.clock_change in CHANGES_OF_SOURCE:
            self._last_ns, self._next_ns = now_ns, now_ns + self._left_ns
        elif now_ns < self._last_ns:
            self._last_ns, self._next_ns = now_ns, now_ns + self._period_ns
        self._times_changed()

    # --- for subclasses

    def _times_changed(self) -> None:
        """The time of the next call has changed."""
        raise NotImplementedError

    def _advance(self, now_ns: int) -> None:
        """A call is made at `now_ns`: plan the next one. Calls that were missed are skipped."""
        self._next_ns += self._period_ns
        if self._next_ns <= now_ns and self._period_ns:
            self._next_ns += ((now_ns - self._next_ns) // self._period_ns + 1) * self._period_ns
        self._last_ns = now_ns

    def _info(self, due_ns: int, now_ns: int) -> TimerInfo:
        """The times, by the clock, of a call that was due at `due_ns` and is made at `now_ns`."""
        called_ns = self.clock.now().nanoseconds
        return TimerInfo(
            expected_call_time=called_ns - (now_ns - due_ns),
            actual_call_time=called_ns,
            clock_type=self.clock.clock_type,
        )

    def _now_ns(self) -> int:
        return _now_ns(self.clock)

    def _check(self) -> None:
        if self.is_destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")


class Timer(Entity, BaseTimer):
    """Calls `callback` every `timer_period_ns`, first after one period; made by `Node.create_timer`.

    A callback gets a TimerInfo if it needs an argument, or has a parameter with this annotation.
    """

    is_single = True
    is_timer = True
    rank = 1

    def __init__(
        self,
        callback: Callable[..., object] | None,
        callback_group: Group,
        timer_period_ns: int,
        clock: Clock,
        *,
        node: Owner,
        autostart: bool = True,
    ) -> None:
        self.callback = callback
        self.sleepers: list[Waiter] = []
        """Threads in `Rate.sleep`: they look again at each change."""
        Entity.__init__(self, node, callback_group)
        BaseTimer.__init__(self, timer_period_ns, clock, autostart=autostart)

    @property
    def callback(self) -> Callable[..., object] | None:
        """Setting it takes effect at the next call."""
        return self._callback

    @callback.setter
    def callback(self, callback: Callable[..., object] | None) -> None:
        self._callback = self._call = callback
        self.is_async = callback is not None and is_async(callback)
        self._wants_info = callback is not None and not takes(callback, 0) and takes(callback, 1)
        if callback is not None and not self._wants_info and (name := _info_parameter(callback)):
            self._wants_info, self._call = True, lambda info: callback(**{name: info})

    def destroy(self) -> None:
        self.node.destroy_timer(self)

    def forget_clock(self) -> None:
        self.wake_sleepers()
        super().forget_clock()

    # --- for the executor, under the guard

    def due_ns(self) -> int:
        """The time of the next call, on the monotonic clock; NEVER_NS if it is unknown."""
        if self._is_canceled or self.is_destroyed or self.is_queued:
            return NEVER_NS
        if self.is_simulated:
            return 0 if self._now_ns() >= self._next_ns else NEVER_NS  # the executor learns each change
        return self._next_ns

    def take(self, most: int) -> Work | None:
        now_ns = self._now_ns() if self.is_simulated else monotonic_ns()
        due_ns, callback = self._next_ns, self._call
        if self._is_canceled or now_ns < due_ns or callback is None:
            return None
        self._advance(now_ns)
        return callback, (self._info(due_ns, now_ns),) if self._wants_info else ()

    def wake_ns(self) -> int:
        """When to look again, on the monotonic clock; 0: after a notification, by the simulation's time."""
        return 0 if self.is_simulated or self._is_canceled else self._next_ns

    def wake_sleepers(self) -> None:
        """Make the sleepers look again after a change."""
        for waiter in self.sleepers:
            waiter.set()

    def rearm(self) -> None:
        """Make the executor and the sleepers read the time again."""
        self.wake_sleepers()
        executor = self.node.own_executor
        if executor is not None:
            executor.on_timers_changed()

    def _times_changed(self) -> None:
        engine().call(self.rearm)


def _info_parameter(callback: Callable[..., object]) -> str | None:
    """The parameter that gets the times by its annotation, as in rclpy. It may have a default."""
    function = getattr(callback, "__func__", callback)
    try:
        if isinstance(function, FunctionType) and TimerInfo not in function.__annotations__.values():
            return None  # most callbacks: `inspect` need not be loaded
        parameters = inspect.signature(callback).parameters.values()
    except Exception:  # some functions in C; annotations can be any code, which only now runs
        return None
    by_name = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return next((one.name for one in parameters if one.annotation is TimerInfo and one.kind in by_name), None)


class Rate:
    """`sleep` ends when the rate's timer fires; made by `Node.create_rate`.

    The timer belongs to its node: an executor that works for the node fires it, in a separate group. If no
    thread spins, or all are in callbacks, a sleeper fires it itself.
    """

    def __init__(self, timer: Timer, *, context: Lifetime) -> None:
        self._timer = timer
        self._context = context
        self._has_fired = False  # no sleep has ended by it yet
        self._is_destroyed = False
        timer.callback = self._fire

    def sleep(self) -> None:
        """Block until the timer fires; return at once if it has fired since the last sleep.

        Raises ROSInterruptException if the context ends meanwhile, or has ended; RuntimeError if the rate is
        destroyed, InvalidHandle if its node is. A destruction meanwhile ends the sleep.
        """
        self._check()
        timer, mover = self._timer, engine()
        with mover.loop:
            waiter = Waiter(mover, self._context)
            timer.sleepers.append(waiter)
            try:
                self._wait(waiter, mover)
            finally:
                timer.sleepers.remove(waiter)
                if not timer.sleepers:
                    self._has_fired = False
        if not self._context.ok():
            raise ROSInterruptException

    def destroy(self) -> None:
        """End the rate; sleeping threads return."""
        self._is_destroyed = True
        engine().call(self._timer.wake_sleepers)

    def _check(self) -> None:
        if not self._context.ok():
            raise ROSInterruptException
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        if self._timer.is_destroyed:
            raise InvalidHandle("Rate cannot sleep because the timer has been destroyed")

    def _wait(self, waiter: Waiter, mover: Engine) -> None:
        timer, is_left_to_executor = self._timer, False
        while not (self._has_fired or self._is_destroyed or timer.is_destroyed) and self._context.ok():
            deadline_ns = timer.wake_ns()
            if timer.is_ready():
                executor = timer.node.own_executor
                if is_left_to_executor or executor is None or not executor.is_looking():
                    timer.take(1)
                    self._notify_sleepers()
                    return
                is_left_to_executor = True
                deadline_ns = monotonic_ns() + _GRACE_NS
            waiter.is_set = False
            if not waiter.wait(deadline_ns) and mover.loop.is_interrupted and mover.is_main():
                return  # the end of the guard raises KeyboardInterrupt

    def _fire(self) -> None:
        engine().call(self._notify_sleepers)

    def _notify_sleepers(self) -> None:
        self._has_fired = True
        self._timer.wake_sleepers()
