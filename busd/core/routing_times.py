"""How long runs stay in busd: a histogram that costs next to nothing to fill.

Owns the buckets. Must not know a clock: the shell measures, from a read off a publisher's socket until all
its runs were handed on.
"""

from bus.wire.records import RoutingRecord

__all__ = ["BOUNDS_US", "RoutingTimes"]

_STEPS = 10
BOUNDS_US = tuple(4**step for step in range(1, _STEPS + 1))
"""From 4 us to 1 s."""


class RoutingTimes:
    """Counts reads with runs, by the time that they took; and the runs."""

    __slots__ = ("_powers", "_runs", "_total_ns")

    def __init__(self) -> None:
        self._runs = 0
        self._total_ns = 0
        self._powers = [0] * 64  # by the number of bits in the microseconds: the cheapest of buckets

    def add(self, runs: int, elapsed_ns: int) -> None:
        """A read brought `runs`, which were handed on `elapsed_ns` later."""
        self._runs += runs
        self._total_ns += elapsed_ns
        self._powers[(elapsed_ns // 1000).bit_length()] += 1

    def record(self, *, samples: int, bytes: int) -> RoutingRecord:
        """All until now, with the samples and bytes that the runs had in them."""
        counts = [0] * (_STEPS + 1)
        for bits, count in enumerate(self._powers):
            counts[min(max(0, (bits - 1) // 2), _STEPS)] += count
        return RoutingRecord(
            runs=self._runs,
            samples=samples,
            bytes=bytes,
            bounds_us=BOUNDS_US,
            counts=tuple(counts),
            total_us=self._total_ns // 1000,
        )
