"""A node's time: the machine's, or a simulation's; and rates, which sleep by it.

Must not know: the source of simulated time (`bus.parameters.time_source`), the work of timers.
"""

import asyncio
from collections.abc import Callable
from time import monotonic_ns, time_ns
from typing import TYPE_CHECKING, Protocol

from bus.errors import ConfigurationError, ConnectionClosed

if TYPE_CHECKING:  # most programs have no timers
    from bus.alarms import Alarm, Alarms

__all__ = ["Clock", "Rate", "TimerOfClock"]

_NS_PER_S = 1_000_000_000
_MOST_HZ = 1e9


class TimerOfClock(Protocol):
    """The interface of a timer for its clock."""

    def _check_clock(self) -> None: ...


class Clock:
    """The time of one node, and the timers and tasks that wait for it. `node` is the full name."""

    def __init__(self, node: str) -> None:
        self.is_simulated = False
        self.epoch = 0
        """Number of jumps that make planned times invalid: back in time, or to another source of time."""
        self.timers: set[TimerOfClock] = set()
        """The running timers."""
        self._node = node
        self._simulated_ns = 0
        self._is_closed = False
        self._waiting: dict[asyncio.Future[None], int] = {}
        self._alarms: Alarms | None = None

    def now_ns(self) -> int:
        """Nanoseconds since 1970, or simulated time."""
        return self._simulated_ns if self.is_simulated else time_ns()

    def steady_ns(self) -> int:
        """The time for durations: the machine's clock that is never set, or simulated time."""
        return self._simulated_ns if self.is_simulated else monotonic_ns()

    def simulate(self, is_simulated: bool) -> None:
        """Take the time from `set` from now on, or from the machine again."""
        if is_simulated is not self.is_simulated:
            self.is_simulated = is_simulated
            self._jump()

    def set(self, now_ns: int) -> None:
        """Set simulated time; it has an effect while simulated time is in use."""
        before_ns, self._simulated_ns = self._simulated_ns, now_ns
        if not self.is_simulated:
            return
        if now_ns < before_ns or not before_ns:  # 0: there was no time before
            self._jump()
            return
        for waiting, due_ns in self._waiting.items():
            if due_ns <= now_ns:
                _wake(waiting)
        self._notify_timers()

    def call_at(self, due_ns: int, callback: Callable[[], object]) -> "Alarm":
        """Call `callback()` on the running event loop when the monotonic clock reaches `due_ns`.

        Cancel it before `close`. Raises ConnectionClosed if the clock is closed.
        """
        if self._alarms is None:
            from bus.alarms import Alarms

            self.check_open()
            self._alarms = Alarms.acquire(asyncio.get_running_loop())
        return self._alarms.add(due_ns, callback)

    async def wait(self, due_ns: int) -> None:
        """Wait until `steady_ns` reaches `due_ns`, or for a jump. It may end early: check again.

        Raises ConnectionClosed if the clock is closed before or meanwhile. Cancellation leaves nothing
        behind.
        """
        self.check_open()
        waiting = asyncio.get_running_loop().create_future()
        alarm = None if self.is_simulated else self.call_at(due_ns, lambda: _wake(waiting))
        self._waiting[waiting] = due_ns
        try:
            await waiting
        finally:
            del self._waiting[waiting]
            if alarm is not None:
                alarm.cancel()
        self.check_open()

    def close(self) -> None:
        """Make `wait` raise ConnectionClosed, including calls that wait already."""
        self._is_closed = True
        self._wake_all()
        if self._alarms is not None:
            self._alarms.release()
            self._alarms = None

    def check_open(self) -> None:
        """Raise ConnectionClosed after `close`."""
        if self._is_closed:
            raise ConnectionClosed(f"node {self._node} is closed")

    def _jump(self) -> None:
        self.epoch += 1
        self._wake_all()
        self._notify_timers()

    def _notify_timers(self) -> None:
        for timer in tuple(self.timers):
            timer._check_clock()

    def _wake_all(self) -> None:
        for waiting in self._waiting:
            _wake(waiting)


class Rate:
    """Sleeps between the turns of a loop to run it `hz` times a second; made by `Node.create_rate`.

    For example:

        rate = node.create_rate(10.0)
        while True:
            drive()
            await rate.sleep()
    """

    def __init__(self, hz: float, clock: Clock) -> None:
        if not 0 < hz <= _MOST_HZ:
            raise ConfigurationError(f"rate {hz!r} Hz is not above 0 and up to {_MOST_HZ:.0f}")
        self.hz = hz
        """Turns in a second."""
        self._period_ns = max(1, round(_NS_PER_S / hz))
        self._clock = clock
        self._epoch = clock.epoch
        self._next_ns = clock.steady_ns() + self._period_ns

    async def sleep(self) -> None:
        """Wait for the next multiple of the period, counted from the rate's creation.

        If that time is past because the turn took longer, it returns at once. The next sleep then ends at the
        next future multiple; missed turns are not made up for. While the node's parameter `use_sim_time` is
        true, multiples are in simulated time. If simulated time begins, ends or jumps back, the period is
        counted anew. Several tasks may use one rate.

        Raises ConnectionClosed if the node is closed before or meanwhile. Cancellation leaves the rate as it
        is.
        """
        clock = self._clock
        clock.check_open()
        end_ns = self._due_ns()
        if clock.steady_ns() >= end_ns:
            self._pass(end_ns)
            await asyncio.sleep(0)  # a loop that is always late must not block all others
            clock.check_open()
            return
        epoch = clock.epoch
        while clock.steady_ns() < end_ns:
            await clock.wait(end_ns)
            if clock.epoch != epoch:
                epoch = clock.epoch
                end_ns = self._due_ns()
        self._pass(end_ns)

    def __repr__(self) -> str:
        return f"<Rate {self.hz:g} Hz>"

    def _due_ns(self) -> int:
        if self._epoch != self._clock.epoch:
            self._epoch = self._clock.epoch
            self._next_ns = self._clock.steady_ns() + self._period_ns
        return self._next_ns

    def _pass(self, end_ns: int) -> None:
        """Plan the next turn after `end_ns`. If several tasks wake, the first one plans it."""
        if self._next_ns == end_ns:
            late_ns = self._clock.steady_ns() - end_ns
            self._next_ns += (late_ns // self._period_ns + 1) * self._period_ns


def _wake(waiting: "asyncio.Future[None]") -> None:
    if not waiting.done():
        waiting.set_result(None)
