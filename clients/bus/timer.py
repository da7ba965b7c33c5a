"""Timers: periodic calls that keep their phase and skip what they missed, as ROS 2's do."""

import asyncio
from collections.abc import Callable
from typing import Any

from bus.base.callbacks import callback_name, is_async
from bus.clock import Clock
from bus.errors import ConfigurationError


class Timer:
    """Calls `callback()` every `period_s` seconds; made by `Node.create_timer`.

    The first call comes after one period. The next call's time advances by whole periods: no drift, and calls
    that could not be made in time are skipped and counted in `missed`, never made up for in a burst. An async
    callback that still runs when the next call is due makes that call a missed one.

    While the node's parameter `use_sim_time` is true the seconds are those of the simulation. Where its time
    begins, ends or jumps back, the next call comes one period from then.

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
        if not 0 <= period_s < 1e9:
            raise ConfigurationError(f"timer period {period_s!r} is not a number of seconds from 0")
        self.period_s = period_s
        """Seconds from one call to the next."""
        self.calls: int = 0
        """Calls that were made."""
        self.missed: int = 0
        """Calls that were skipped."""
        self._period_ns = round(period_s * 1e9)
        self._callback = callback
        self._is_async = is_async(callback)
        self._on_error = on_error
        self._loop = asyncio.get_running_loop()
        self._clock = clock
        self._epoch = clock.epoch
        self._handle: asyncio.TimerHandle | None = None
        self._task: asyncio.Task[None] | None = None
        self._next_ns = 0
        self.reset()

    def __repr__(self) -> str:
        state = "canceled " if self.is_canceled else ""
        counts = f"calls={self.calls} missed={self.missed}"
        name = f"{state}{callback_name(self._callback)}"
        return f"<{type(self).__name__} {name} every {self.period_s:g} s {counts}>"

    @property
    def is_canceled(self) -> bool:
        """Whether no call will come, unless `reset`."""
        return self not in self._clock.timers

    def cancel(self) -> None:
        """No more calls, until `reset`. An async callback that runs is left to end."""
        self._clock.timers.discard(self)
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def reset(self) -> None:
        """The next call comes one period from now, also after `cancel`."""
        self.cancel()
        self._clock.timers.add(self)
        self._epoch = self._clock.epoch
        self._next_ns = self._clock.steady_ns() + self._period_ns
        self._arm(self._period_ns)

    def close(self) -> None:
        """Cancel, also an async callback that runs."""
        self.cancel()
        if self._task is not None:
            self._task.cancel()

    def _look_at_clock(self) -> None:
        """For the clock: it has jumped, or shows another simulated time."""
        if self.is_canceled:
            return
        if self._epoch != self._clock.epoch:
            self.reset()
        elif self._clock.steady_ns() >= self._next_ns:
            self._fire()

    def _arm(self, delay_ns: int) -> None:
        if not self._clock.is_simulated:
            self._handle = self._loop.call_later(max(delay_ns, 0) / 1e9, self._fire)

    def _fire(self) -> None:
        now_ns = self._clock.steady_ns()
        if now_ns < self._next_ns:
            self._arm(self._next_ns - now_ns)  # the loop's clock is coarser than ours
            return
        self._next_ns += self._period_ns
        if self._next_ns <= now_ns and self._period_ns:
            skipped = (now_ns - self._next_ns) // self._period_ns + 1
            self.missed += skipped
            self._next_ns += skipped * self._period_ns
        self._arm(self._next_ns - self._clock.steady_ns())
        if self._task is not None and not self._task.done():
            self.missed += 1
            return
        self.calls += 1
        if self._is_async:
            self._task = self._loop.create_task(self._run(), name="timer callback")
            return
        try:
            self._callback()
        except Exception as error:
            self._on_error(error)

    async def _run(self) -> None:
        try:
            await self._callback()
        except Exception as error:
            self._on_error(error)
