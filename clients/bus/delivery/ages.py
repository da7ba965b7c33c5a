"""How old messages were when they were taken: of the first some after each report, then of one in some.

Pure. The native reader counts likewise (`bus.shm`, py_take.c), and what it has counted is added here.
"""

from bus.wire.layout import MAX_COUNT

AT_ONCE = 8
"""So many are looked at before most are passed over; by the native reader, to which it costs less, 64."""

EACH = 128
"""Of so many one is looked at then: a look costs half of a take, so this is 0.4 % of them all."""


class Ages:
    """`window`: messages since the last report, or that report's figures if there were none."""

    __slots__ = ("_last", "count", "most_ns", "sum_ns")

    def __init__(self) -> None:
        self._last = 0, 0, 0
        self.count = self.sum_ns = self.most_ns = 0

    def add(self, age_ns: int) -> int:
        """A message of this age was taken; returns how many to take before the next that counts, that one
        included."""
        self.count += 1
        if 0 < age_ns < MAX_COUNT - self.sum_ns:  # stamps may lie
            self.sum_ns += age_ns
            if age_ns > self.most_ns:
                self.most_ns = age_ns
        return 1 if self.count < AT_ONCE else EACH

    def add_all(self, count: int, sum_ns: int, most_ns: int) -> None:
        """Others have counted so many."""
        self.count += count
        self.sum_ns = min(self.sum_ns + sum_ns, MAX_COUNT)
        self.most_ns = max(self.most_ns, most_ns)

    @property
    def window(self) -> tuple[int, int, int]:
        """How many, the sum of their ages in nanoseconds, the highest."""
        return (self.count, self.sum_ns, self.most_ns) if self.count else self._last

    def report(self) -> tuple[int, int, int]:
        """The counts since the last call, as for `window`; later messages count for the next call."""
        since = self.count, self.sum_ns, self.most_ns
        if self.count:
            self._last = since
        self.count = self.sum_ns = self.most_ns = 0
        return since
