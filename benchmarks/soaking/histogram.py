"""Durations counted in buckets: the same size after a day as after a second, and several can be added.

Pure. Each bucket is a twelfth of a doubling wide, so its value is at most 6 % too high.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

from bus_cli.bench.figures import PERCENTILES

_PARTS = 12
_log2 = math.log2


class Percentiles(NamedTuple):
    """Percentiles in µs, and the number of samples."""

    samples: int
    p50: float
    p90: float
    p99: float
    p99_9: float
    max: float


class Histogram:
    """A histogram of durations in ns."""

    def __init__(self, counts: Mapping[int, int] | None = None, max_ns: int = 0) -> None:
        self.counts = dict(counts or {})
        self.max_ns = max_ns

    def add(self, duration_ns: int) -> None:
        """Count a duration; below 1 ns it counts as 1 ns."""
        bucket = int(_log2(duration_ns) * _PARTS) if duration_ns > 1 else 0
        self.counts[bucket] = self.counts.get(bucket, 0) + 1
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns

    def merge(self, other: Self) -> None:
        """Add all counts of `other`."""
        for bucket, count in other.counts.items():
            self.counts[bucket] = self.counts.get(bucket, 0) + count
        self.max_ns = max(self.max_ns, other.max_ns)

    def percentiles(self) -> Percentiles | None:
        """Percentiles by nearest rank. Each is the upper end of its bucket, but the max is exact. None
        without samples."""
        total = sum(self.counts.values())
        if not total:
            return None
        ranks = (math.ceil(round(percent * total / 100, 9)) for percent in PERCENTILES[:-1])
        p50, p90, p99, p99_9 = map(self._at, ranks)
        return Percentiles(total, p50, p90, p99, p99_9, self.max_ns / 1000)

    def _at(self, rank: int) -> float:
        for bucket in sorted(self.counts):
            rank -= self.counts[bucket]
            if rank <= 0:
                return float(min(2 ** ((bucket + 1) / _PARTS), self.max_ns)) / 1000
        raise AssertionError("the counts do not add up")
