"""Timers of an AsyncNode: the times of rclpy's timers, and alarms of the event loop."""

import asyncio
from collections.abc import Callable
from typing import Any

from bus.alarms import Alarm, Alarms
from bus.base.callbacks import is_async, refuse_coroutine, takes
from bus.diagnostics.slow_callback import watched
from bus_ros.rclpy.clock import BaseClock
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner, EntityState, current_task
from bus_ros.rclpy.timer import BaseTimer

__all__ = ["AsyncTimer"]


class AsyncTimer(AsyncEntity, BaseTimer):
    """Calls `callback`, with a TimerInfo if it takes an argument; made by `AsyncNode.create_timer`.

    Its calls never overlap. Calls that are missed meanwhile are skipped.
    """

    def __init__(
        self,
        owner: AsyncOwner,
        timer_period_ns: int,
        callback: Callable[..., Any],
        clock: BaseClock,
        *,
        autostart: bool,
    ) -> None:
        AsyncEntity.__init__(self, owner)
        BaseTimer.__init__(self, timer_period_ns, clock, autostart=autostart)
        self.callback = callback
        self._alarms: Alarms | None = None
        self._alarm: Alarm | None = None
        self._task: asyncio.Task[Any] | None = None  # a running async callback

    @property
    def callback(self) -> Callable[..., Any]:
        """Setting it takes effect at the next call. Raises RuntimeError if it needs two arguments or more."""
        return self._callback

    @callback.setter
    def callback(self, callback: Callable[..., Any]) -> None:
        self._wants_info = not takes(callback, 0)
        if self._wants_info and not takes(callback, 1):
            raise RuntimeError("a timer's callback takes no argument, or one (a TimerInfo)")
        self._callback = callback
        self._is_async = is_async(callback)
        self._call = watched(
            callback, f"timer of {self.node.get_fully_qualified_name()}", self.node.native.get_logger()
        )

    def cancel(self) -> None:
        super().cancel()
        self._disarm()

    # --- inside

    def _became_open(self) -> None:
        self._alarms = Alarms.acquire(asyncio.get_running_loop())
        self._times_changed()

    def _stop(self) -> None:
        self._disarm()
        self.forget_clock()
        alarms, self._alarms = self._alarms, None
        if alarms is not None:
            alarms.release()
        if self._task is not None and self._task is not current_task():
            self._task.cancel()

    def _times_changed(self) -> None:
        self._disarm()
        if self.state is not EntityState.OPEN or self._is_canceled or self._task is not None:
            return
        assert self._alarms is not None
        if not self.is_simulated:
            self._alarm = self._alarms.add(self._next_ns, self._fire)
        elif self._now_ns() >= self._next_ns:
            self._alarm = self._alarms.add(0, self._fire)  # else the clock calls at its next change

    def _disarm(self) -> None:
        alarm, self._alarm = self._alarm, None
        if alarm is not None:
            alarm.cancel()

    def _fire(self) -> None:
        self._alarm = None
        due_ns, now_ns = self._next_ns, self._now_ns()
        self._advance(now_ns)
        arguments = (self._info(due_ns, now_ns),) if self._wants_info else ()
        if self._is_async:
            self._task = self._owner.run_in_group(self._call(*arguments))
            if self._task is not None:
                self._task.add_done_callback(self._called)
            return
        try:
            if (answer := self._call(*arguments)) is not None:
                refuse_coroutine(self._callback, answer)
        except Exception as error:
            self._owner.fail(error)
        finally:
            if self._alarm is None and not self.is_destroyed:  # the callback may have reset it
                self._times_changed()

    def _called(self, task: "asyncio.Task[Any]") -> None:
        self._task = None
        if not self.is_destroyed:
            self._times_changed()
