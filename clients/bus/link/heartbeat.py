"""Signs of life for the broker, and how a program learns that its event loop stood still.

A late heartbeat shows a standstill. It may be noticed first by the timer here, or by a callback that has its
turn before the timer.
"""

import asyncio
from collections.abc import Callable
from time import monotonic_ns

from bus.process.shared_loop import GuardedLoop

__all__ = ["LATE_NS", "Heartbeat"]

LATE_NS = 1_000_000_000
"""A timer that is so late shows that this event loop stood still."""


class Heartbeat:
    """Calls `on_due` once after each `start`."""

    def __init__(self, on_due: Callable[[float], None]) -> None:
        self._on_due = on_due
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._began_ns = self._due_ns = 0  # since and until when the next one is waited for

    def start(self, interval_s: float) -> int:
        """Call `on_due(interval_s)` then; returns from when on that is late, in ns of the monotonic clock."""
        self.stop()
        self._began_ns = monotonic_ns()
        self._due_ns = self._began_ns + int(interval_s * 1e9)
        self._timer = self._loop.call_later(interval_s, self._on_due, interval_s)
        return self._due_ns + LATE_NS

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def standstill(self, now_ns: int, turn_ns: int, lease_s: float) -> str:
        """How long the event loop stood still until now, as a text; "" if that was shorter than the lease.

        `turn_ns`: when it last had a turn that is known of.
        """
        most_s = (now_ns - self._began_ns) / 1e9
        if most_s < lease_s or (isinstance(self._loop, GuardedLoop) and self._loop.rests):
            return ""
        if turn_ns > self._began_ns:
            return f"{(now_ns - turn_ns) / 1e9:.0f} s"
        least, most = f"{(now_ns - self._due_ns) / 1e9:.0f}", f"{most_s:.0f}"
        return f"{most} s" if least == most else f"{least} to {most} s"
