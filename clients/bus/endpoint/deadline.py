"""Watches for gaps between messages that are longer than the QoS deadline."""

import asyncio
from collections.abc import Callable
from time import monotonic_ns
from typing import Protocol

__all__ = ["DeadlineWatch"]


class Later(Protocol):
    """The event loop's timers."""

    def later(self, delay_s: float, call: Callable[[], object], /) -> asyncio.TimerHandle: ...


class DeadlineWatch:
    """Calls `on_missed` after each `deadline_ns` without a message, from the first message until `end`.

    `newest_ns` returns the time of the newest message that was not set as `last_ns`.
    """

    def __init__(
        self,
        loop: Later,
        deadline_ns: int,
        newest_ns: Callable[[], int],
        on_missed: Callable[[], object],
    ) -> None:
        self.last_ns = self._begun_ns = monotonic_ns()
        """Time of the last message."""
        self._loop = loop
        self._deadline_ns = deadline_ns
        self._newest_ns = newest_ns
        self._on_missed = on_missed
        self._arm()

    def end(self) -> None:
        self._timer.cancel()

    def _arm(self) -> None:
        due_ns = self.last_ns + self._deadline_ns - monotonic_ns()
        self._timer = self._loop.later(max(due_ns, 0) / 1e9, self._check)

    def _check(self) -> None:
        self.last_ns = max(self.last_ns, self._newest_ns())
        now_ns = monotonic_ns()
        if self.last_ns <= self._begun_ns:  # no message yet
            self._timer = self._loop.later(self._deadline_ns / 1e9, self._check)
            return
        is_missed = now_ns - self.last_ns >= self._deadline_ns
        if is_missed:
            self.last_ns = now_ns
        self._arm()  # first, because `on_missed` may call `end`
        if is_missed:
            self._on_missed()
