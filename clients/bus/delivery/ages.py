"""Ages of messages at the time when they were taken. After each report the first few count, then one of many.

Pure. The native reader counts in the same way (`bus.shm`, py_take.c), and its counts are added here.
"""

from bus.base.time_parts import PARTS, part_of, trimmed
from bus.wire.layout import MAX_COUNT

AT_ONCE = 8
"""Messages after a report that all count. The native reader counts 64, because that costs it less."""

EACH = 128
"""After them, one message of this number counts. Counting costs half of a take, so this adds 0.4 %."""


class Ages:
    """`window`: messages since the last report, or that report's figures if there were none."""

    __slots__ = ("_last", "_parts", "count", "most_ns", "sum_ns")

    def __init__(self) -> None:
        self._last = 0, 0, 0
        self.count = self.sum_ns = self.most_ns = 0
        self._parts = [0] * PARTS

    def add(self, age_ns: int) -> int:
        """Count a taken message of this age. Returns 1 if the next message counts, 2 if the one after that,
        and so on."""
        self.count += 1
        if 0 < age_ns < MAX_COUNT - self.sum_ns:  # stamps may be false
            self.sum_ns += age_ns
            self._parts[part_of(age_ns)] += 1
            if age_ns > self.most_ns:
                self.most_ns = age_ns
        return 1 if self.count < AT_ONCE else EACH

    def add_all(self, count: int, sum_ns: int, most_ns: int, parts: tuple[int, ...]) -> None:
        """Add counts of the native reader."""
        for part, number in enumerate(parts):
            self._parts[part] += number
        self.count += count
        self.sum_ns = min(self.sum_ns + sum_ns, MAX_COUNT)
        self.most_ns = max(self.most_ns, most_ns)

    @property
    def window(self) -> tuple[int, int, int]:
        """Number of messages, the sum of their ages in nanoseconds, the highest age."""
        return (self.count, self.sum_ns, self.most_ns) if self.count else self._last

    def report(self) -> tuple[int, int, int, tuple[int, ...]]:
        """The counts since the last call, as for `window`, and how many ages each part of a histogram has.
        Later messages count for the next call."""
        since = self.count, self.sum_ns, self.most_ns
        parts = trimmed(self._parts)
        if self.count:
            self._last = since
            self._parts = [0] * PARTS
        self.count = self.sum_ns = self.most_ns = 0
        return *since, parts
