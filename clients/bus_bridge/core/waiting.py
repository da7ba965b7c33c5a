"""Messages that wait for their way, bounded in number and bytes, and the rates that rules allow. Pure."""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import islice

from bus_bridge.engine import Sample

__all__ = ["RateLimit", "Waiting"]

_NS_PER_S = 1_000_000_000
_NEVER_NS = 1 << 63
_SLACK = 0.05
"""By how much of a period a message may be early: publishers' timers are not exact."""


class Waiting:
    """At most `max_bytes`, but always room for one message."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._samples: deque[Sample] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def bytes(self) -> int:
        return self._bytes

    def put(self, samples: Iterable[Sample], depth: int | None) -> tuple[int, int]:
        """Put them behind the others; the oldest beyond the bounds go. `depth` None: as many as there are.

        Returns how many went because of the depth, and how many because of the bytes.
        """
        waiting = self._samples
        for sample in samples:
            waiting.append(sample)
            self._bytes += len(sample.payload)
        replaced = 0 if depth is None else max(0, len(waiting) - depth)
        for _ in range(replaced):
            self._bytes -= len(waiting.popleft().payload)
        over = 0
        while self._bytes > self._max_bytes and len(waiting) > 1:
            self._bytes -= len(waiting.popleft().payload)
            over += 1
        return replaced, over

    def first(self, limit: int) -> list[Sample]:
        """Up to `limit` of the oldest; they stay."""
        return list(islice(self._samples, limit))

    def remove(self, count: int) -> None:
        """The oldest `count` have gone on."""
        for _ in range(count):
            self._bytes -= len(self._samples.popleft().payload)

    def clear(self) -> int:
        """Returns how many waited."""
        count = len(self._samples)
        self._samples.clear()
        self._bytes = 0
        return count


class RateLimit:
    """Lets at most `hz` messages in a second pass, by the time of their publication."""

    def __init__(self, hz: float) -> None:
        self._period_ns = int(_NS_PER_S / hz)
        self._slack_ns = int(self._period_ns * _SLACK)
        self._due_ns = -_NEVER_NS

    def passing(self, samples: Sequence[Sample]) -> list[Sample]:
        """Those of `samples`, which come in order, that may go on."""
        return [sample for sample in samples if self._passes(sample.source_time_ns)]

    def _passes(self, time_ns: int) -> bool:
        late_ns = time_ns - self._due_ns
        if -2 * self._period_ns <= late_ns < -self._slack_ns:
            return False
        # On time, the schedule goes on from when it was due, so that the mean rate is exact. After a pause,
        # or where the publisher's clock was set back, it begins anew.
        is_on_time = -self._slack_ns <= late_ns < self._period_ns
        self._due_ns = (self._due_ns if is_on_time else time_ns) + self._period_ns
        return True
