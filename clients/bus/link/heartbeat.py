"""Signs of life for the broker, and a check whether the event loop stood still.

A late heartbeat shows a standstill. The timer here may notice it first, or a callback that has its turn
before the timer.
"""

import asyncio
from collections.abc import Callable
from time import monotonic_ns

from bus.process import guarded

__all__ = ["LATE_NS", "Heartbeat"]

LATE_NS = 1_000_000_000
"""If a timer is this late, the event loop stood still."""


class Heartbeat:
    """Calls `on_due` once after each `start`."""

    def __init__(self, on_due: Callable[[float], None]) -> None:
        self._on_due = on_due
        self._loop = asyncio.get_running_loop()
        self._guarded_loop = guarded(self._loop)
        self._timer: asyncio.TimerHandle | None = None
        self._began_ns = self._due_ns = 0  # begin and end of the wait for the next heartbeat

    def start(self, interval_s: float) -> int:
        """Call `on_due(interval_s)` after that time.

        Returns the time, in ns, after which the call is late.
        """
        self.stop()
        self._began_ns = monotonic_ns()
        self._due_ns = self._began_ns + int(interval_s * 1e9)
        self._timer = self._loop.call_later(interval_s, self._on_due, interval_s)
        return self._due_ns + LATE_NS

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def standstill(self, now_ns: int, turn_ns: int, lease_s: float) -> str:
        """The length of a standstill of the event loop until now, as a text; "" if shorter than the lease.

        `turn_ns`: the time of the loop's last known turn.
        """
        most_s = (now_ns - self._began_ns) / 1e9
        if most_s < lease_s or (self._guarded_loop is not None and self._guarded_loop.rests):
            return ""
        if turn_ns > self._began_ns:
            return f"{(now_ns - turn_ns) / 1e9:.0f} s"
        least, most = f"{(now_ns - self._due_ns) / 1e9:.0f}", f"{most_s:.0f}"
        return f"{most} s" if least == most else f"{least} to {most} s"
