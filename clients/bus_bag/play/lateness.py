"""The lateness of published messages: percentiles of any number of them in little memory. Pure."""

from collections import Counter

__all__ = ["Lateness"]

_FINE_BITS = 5


class Lateness:
    """Counts times by their first six binary digits: a percentile is accurate to 3 %, the maximum is
    exact."""

    def __init__(self) -> None:
        self.count = 0
        self.max_ns = 0
        self._counts: Counter[int] = Counter()

    def add(self, late_ns: int) -> None:
        """Count one message that was not early."""
        self.count += 1
        self.max_ns = max(self.max_ns, late_ns)
        coarse = max(0, late_ns.bit_length() - _FINE_BITS - 1)
        self._counts[late_ns >> coarse << coarse] += 1

    def percentile(self, percent: float) -> int:
        """In nanoseconds; 0 if there were no messages."""
        left = self.count * percent / 100
        for late_ns in sorted(self._counts):
            left -= self._counts[late_ns]
            if left <= 0:
                return late_ns
        return self.max_ns

    def __str__(self) -> str:
        figures = {"p50": self.percentile(50), "p99": self.percentile(99), "max": self.max_ns}
        return ", ".join(f"{name} {late_ns / 1e6:.3f} ms" for name, late_ns in figures.items())
