"""Wakes the core up when one of its timers is due.

If this process was stopped or starved meanwhile, peers with seemingly ended leases may have sent something.
So the core is woken up a moment later, after busd has read it. It happens once for each timer. So leases also
end on a machine that is always late.
"""

import asyncio
from collections.abc import Callable
from time import monotonic_ns

from busd.core.timers import NEVER_NS, Timers

__all__ = ["Alarm"]

_LATE_NS = 250_000_000
"""A timer that is so late shows that this process was stopped or starved."""
_GRACE_NS = 50_000_000
_CLOSED_NS = -1
"""Earlier than any timer of the core: a closed alarm is not set again."""


class Alarm:
    """Calls `on_due` with the present time when the earliest of `timers` is due.

    `set` must be called after whatever may have added a timer, if that is earlier than `due_ns`.
    """

    def __init__(self, timers: Timers, on_due: Callable[[int], None]) -> None:
        self.due_ns = NEVER_NS
        """The timer for which the alarm is set."""
        self._timers = timers
        self._on_due = on_due
        self._loop = asyncio.get_running_loop()
        self._handle: asyncio.TimerHandle | None = None
        self._wake_ns = 0

    def set(self) -> None:
        """Set the alarm for the earliest timer."""
        due_ns = self._timers.earliest_ns
        if due_ns < self.due_ns:
            self._cancel()
            self.due_ns = due_ns
            self._wake_at(due_ns, self._ring)

    def close(self) -> None:
        """Wake the core up no more."""
        self._cancel()
        self.due_ns = _CLOSED_NS

    def _cancel(self) -> None:
        if self._handle is not None:
            self._handle.cancel()

    def _wake_at(self, due_ns: int, action: Callable[[], None]) -> None:
        now_ns = monotonic_ns()
        self._wake_ns = max(now_ns, due_ns)
        self._handle = self._loop.call_later((self._wake_ns - now_ns) / 1e9, action)

    def _ring(self) -> None:
        """The timer is due; if busd is late, let it read first."""
        now_ns = monotonic_ns()
        if now_ns - self._wake_ns > _LATE_NS:
            self._wake_at(now_ns + _GRACE_NS, self._wake_core)
        else:
            self._wake_core()

    def _wake_core(self) -> None:
        self.due_ns = NEVER_NS
        self._on_due(monotonic_ns())
        self.set()
