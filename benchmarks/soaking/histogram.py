"""How long things took, counted in buckets: as small after a day as after a second, and sums of several.

Pure. Each bucket is a twelfth of a doubling wide, so what it says of a value is at most 6 % too much.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

from bus_cli.bench.figures import PERCENTILES

_PARTS = 12
_log2 = math.log2


class Percentiles(NamedTuple):
    """In µs, of so many samples."""

    samples: int
    p50: float
    p90: float
    p99: float
    p99_9: float
    max: float


class Histogram:
    """Of durations in ns."""

    def __init__(self, counts: Mapping[int, int] | None = None, max_ns: int = 0) -> None:
        self.counts = dict(counts or {})
        self.max_ns = max_ns

    def add(self, duration_ns: int) -> None:
        """One more; what is less than 1 ns counts as that."""
        bucket = int(_log2(duration_ns) * _PARTS) if duration_ns > 1 else 0
        self.counts[bucket] = self.counts.get(bucket, 0) + 1
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns

    def merge(self, other: Self) -> None:
        """All of `other` as well."""
        for bucket, count in other.counts.items():
            self.counts[bucket] = self.counts.get(bucket, 0) + count
        self.max_ns = max(self.max_ns, other.max_ns)

    def percentiles(self) -> Percentiles | None:
        """By nearest rank, each as the upper end of its bucket, the max exactly; None of nothing."""
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
