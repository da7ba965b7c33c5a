"""Asks importers for their progress if no acks arrive."""

import asyncio
from collections.abc import Callable

from bus_bridge.zenoh.window import Window

__all__ = ["Probing"]

_FIRST_S = 0.02
_LONGEST_S = 1.0


class Probing:
    """Asks the importers of `window`. `ask` sends the question. `is_stuck` returns whether a part waits for
    room."""

    def __init__(self, window: Window, ask: Callable[[], None], is_stuck: Callable[[], bool]) -> None:
        self._window = window
        self._ask = ask
        self._is_stuck = is_stuck
        self._timer: asyncio.TimerHandle | None = None
        self._in_flight_before = 0

    def begin(self) -> None:
        """Start checks of the importers' progress, for as long as a part waits for room."""
        if self._timer is None:
            self._arm(_FIRST_S)

    def scan(self) -> None:
        """Check once a second whether parts arrive: if the last parts are lost, no later part reveals it."""
        in_flight, before = self._window.in_flight, self._in_flight_before
        self._in_flight_before = in_flight
        if in_flight and in_flight >= before:
            self._ask()

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _arm(self, delay_s: float) -> None:
        before = self._window.in_flight
        self._timer = asyncio.get_running_loop().call_later(delay_s, self._check, before, delay_s)

    def _check(self, before: int, delay_s: float) -> None:
        self._timer = None
        if not self._is_stuck():
            return
        if self._window.in_flight != before:
            self._arm(_FIRST_S)
        else:  # a question or its answer was dropped
            self._ask()
            self._arm(min(2 * delay_s, _LONGEST_S))
