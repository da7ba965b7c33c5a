"""Rates from counters that arrive now and then. Pure: times come in as arguments."""

from collections import deque
from operator import lt

__all__ = ["HISTORY_S", "Meter", "RateHistory"]

_NS = 1_000_000_000
_WINDOW_NS = 2 * _NS
"""The time for which a rate is calculated: half a second of 10 Hz has four or five messages, or six."""
_SILENCE_NS = 5 * _NS // 2
"""Processes report changes twice a second; of a thousand endpoints, every two seconds. A process that has not
reported for longer than this, and for twice its usual pause, has nothing to report.
"""

HISTORY_S = 60
"""How many seconds a history has, a value for each."""


class Meter:
    """Some counters of one endpoint that grow together, such as messages and bytes, reported at the same
    time.
    """

    __slots__ = ("_rates", "_silent_ns", "_told")

    def __init__(self) -> None:
        self._told: deque[tuple[int, tuple[int, ...]]] = deque()
        self._rates: tuple[float, ...] | None = None
        """Rates from the added counters, valid until `_silent_ns`; None: not calculated."""
        self._silent_ns = 0

    def add(self, at_ns: int, *counters: int) -> None:
        """Add the counters of time `at_ns`; a time of 0, or one not newer than the last, is ignored."""
        told = self._told
        if told:
            last_ns, last = told[-1]
            if at_ns <= last_ns:
                return
            self._rates = None
            if any(map(lt, counters, last)):
                told.clear()  # another process has them now, or another busd
        elif not at_ns:
            return
        told.append((at_ns, counters))
        while len(told) > 2 and told[1][0] <= at_ns - _WINDOW_NS:
            told.popleft()

    def rates(self, now_ns: int) -> tuple[float, ...] | None:
        """Per second, of each counter; None until they were reported twice."""
        if self._rates is None:
            told = self._told
            if len(told) < 2:
                return None
            (began_ns, first), (ended_ns, last) = told[0], told[-1]
            span_ns = ended_ns - began_ns
            self._rates = tuple([(new - old) * _NS / span_ns for old, new in zip(first, last, strict=True)])
            self._silent_ns = ended_ns + max(_SILENCE_NS, 2 * (ended_ns - told[-2][0]))
        if now_ns > self._silent_ns:
            return (0.0,) * len(self._rates)
        return self._rates


class RateHistory:
    """A value for each of the last 60 seconds, the newest last; fewer in the beginning."""

    __slots__ = ("_last_ns", "_values")

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=HISTORY_S)
        self._last_ns = 0

    def add(self, now_ns: int, value: float) -> bool:
        """Add the value if a second has passed since the last; returns whether it did. Seconds without a look
        get the value of the next look."""
        passed = (now_ns - self._last_ns + _NS // 4) // _NS if self._last_ns else 1  # a look may come early
        if passed < 1:
            return False
        self._last_ns = self._last_ns + passed * _NS if self._last_ns else now_ns
        self._values.extend([value] * min(passed, HISTORY_S))
        return True

    def __len__(self) -> int:
        return len(self._values)

    @property
    def values(self) -> tuple[float, ...]:
        return tuple(self._values)
