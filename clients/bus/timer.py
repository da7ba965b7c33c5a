"""Timers: periodic calls that keep their phase and skip missed calls, like ROS 2's."""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bus.base.callbacks import call_async, callback_name, is_async, refuse_coroutine
from bus.clock import Clock
from bus.errors import ConfigurationError

if TYPE_CHECKING:
    from bus.alarms import Alarm

_LONGEST_S = 1e9


class Timer:
    """Calls `callback()` every `period_s` seconds; made by `Node.create_timer`.

    The first call comes after one period. The time of the next call advances by whole periods, so calls don't
    drift. Calls that are too late are skipped and counted in `missed`; no burst makes up for them. If an
    async callback still runs when the next call is due, that call is missed.

    On Linux, calls are some ten microseconds late, whatever the period. This needs a timer of the kernel,
    which the native core has, and Python from 3.13 on. Without one, the event loop's timers are used: calls
    are up to a millisecond late, and periods below 1 ms miss calls (asyncio) or use a whole CPU (uvloop).

    While the node's parameter `use_sim_time` is true, seconds are simulated time. If simulated time begins,
    ends or jumps back, the next call comes one period from then.

        timer = node.create_timer(1.0, lambda: print(timer.calls))
    """

    def __init__(
        self,
        period_s: float,
        callback: Callable[[], Any],
        on_error: Callable[[BaseException], None],
        clock: Clock,
    ) -> None:
        if callable(period_s):
            raise ConfigurationError("the period comes first: create_timer(0.5, callback)")
        self._period_ns = _as_ns(period_s)
        self._period_s = period_s
        self.calls: int = 0
        """Calls that were made."""
        self.missed: int = 0
        """Calls that were skipped."""
        self._callback = callback
        self._is_async = is_async(callback)
        self._on_error = on_error
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._epoch = clock.epoch
        self._alarm: Alarm | None = None
        self._task: asyncio.Task[None] | None = None
        self._next_ns = 0
        self.reset()

    def __repr__(self) -> str:
        state = "canceled " if self.is_canceled else ""
        counts = f"calls={self.calls} missed={self.missed}"
        name = f"{state}{callback_name(self._callback)}"
        return f"<{type(self).__name__} {name} every {self._period_s:g} s {counts}>"

    @property
    def period(self) -> float:
        """Seconds from one call to the next.

        Setting it takes effect now: the next call comes one new period after the last one, or at once if that
        time is past. A canceled timer stays canceled. Raises ConfigurationError for a period below 0 or above
        1e9.
        """
        return self._period_s

    @period.setter
    def period(self, period_s: float) -> None:
        before_ns, self._period_ns = self._period_ns, _as_ns(period_s)
        self._period_s = period_s
        if self._period_ns != before_ns and not self.is_canceled:
            self._next_ns = max(self._next_ns - before_ns + self._period_ns, self._clock.steady_ns())
            self._arm()

    @property
    def period_s(self) -> float:
        """The same as `period`; read-only."""
        return self._period_s

    @property
    def is_canceled(self) -> bool:
        """Whether no call will come, unless `reset`."""
        return self not in self._clock.timers

    def cancel(self) -> None:
        """No more calls, until `reset`. An async callback that runs is left to end."""
        self._clock.timers.discard(self)
        self._disarm()

    def reset(self) -> None:
        """The next call comes one period from now, also after `cancel`.

        Raises ConnectionClosed if the node is closed.
        """
        self._clock.check_open()
        self._clock.timers.add(self)
        self._epoch = self._clock.epoch
        self._next_ns = self._clock.steady_ns() + self._period_ns
        self._arm()

    def close(self) -> None:
        """Cancel, also an async callback that runs."""
        self.cancel()
        if self._task is not None:
            self._task.cancel()

    def _check_clock(self) -> None:
        """Handle a jump of the clock, or a new simulated time. Called by the clock."""
        if self.is_canceled:
            return
        if self._epoch != self._clock.epoch:
            self.reset()
        elif self._clock.steady_ns() >= self._next_ns:
            self._fire()

    def _arm(self) -> None:
        self._disarm()
        if not self._clock.is_simulated:
            self._alarm = self._clock.call_at(self._next_ns, self._fire)

    def _disarm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    def _fire(self) -> None:
        now_ns = self._clock.steady_ns()
        self._alarm = None
        self._next_ns += self._period_ns
        if not self._period_ns:
            self._next_ns = now_ns
        elif self._next_ns <= now_ns:
            skipped = (now_ns - self._next_ns) // self._period_ns + 1
            self.missed += skipped
            self._next_ns += skipped * self._period_ns
        try:
            self._call()
        finally:
            # Only now, to start the call sooner. The call itself may have canceled or reset the timer.
            if self._alarm is None and not self.is_canceled:
                self._arm()

    def _call(self) -> None:
        if self._task is not None and not self._task.done():
            self.missed += 1
            return
        self.calls += 1
        if self._is_async:
            self._task = self._loop.create_task(self._run(), name="timer callback")
            return
        try:
            if (answer := self._callback()) is not None:
                refuse_coroutine(self._callback, answer)
        except Exception as error:
            self._on_error(error)

    async def _run(self) -> None:
        try:
            await call_async(self._callback)
        except Exception as error:
            self._on_error(error)


def _as_ns(period_s: float) -> int:
    try:
        if 0 <= period_s <= _LONGEST_S:
            return round(period_s * 1e9)
    except TypeError:
        pass
    raise ConfigurationError(
        f"timer period {period_s!r} is not a number of seconds from 0 to {_LONGEST_S:.0f}"
    )
