"""Messages that wait for their route, limited in number and bytes, and the rates that rules allow. Pure."""

from collections import deque
from collections.abc import Iterable
from itertools import islice

from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.packed import Packed

__all__ = ["RateLimit", "Waiting"]

_MOST_MESSAGES = 1 << 22
"""A limit for short messages. A message that was not packed takes about 180 bytes besides its payload."""
_NS_PER_S = 1_000_000_000
_NEVER_NS = 1 << 63
_SLACK = 0.05
"""Part of a period by which a message may be early: publishers' timers are not exact."""


class Waiting:
    """A queue with a limit of `max_bytes` of payload (but always room for one message) and four million
    messages.

    Packed messages stay packed while they wait.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._parts: deque[Sample | Packed] = deque()
        self.count = 0
        """Number of messages."""
        self.bytes = 0

    def put(self, batch: Batch, depth: int | None) -> tuple[int, int]:
        """Add messages at the end; the oldest ones above the limits are dropped. `depth` None: no limit by
        number.

        Returns how many were dropped because of the depth, and how many because of the memory.
        """
        if batch.__class__ is Packed:
            self._parts.append(batch)
        else:
            self._parts += batch
        self.count += batch.count
        self.bytes += batch.payload_bytes
        replaced = 0 if depth is None else max(0, self.count - depth)
        self.remove(replaced)
        over = 0
        while self.bytes > self.max_bytes and self.count > 1:
            self.remove(1)
            over += 1
        if (many := self.count - _MOST_MESSAGES) > 0:
            self.remove(many)
            over += many
        return replaced, over

    def first(self, limit: int) -> Batch | None:
        """Some of the oldest messages, at most `limit` if they are not packed. They stay in the queue. None
        if it is empty."""
        if self._parts and isinstance(first := self._parts[0], Packed):
            return first
        found = list[Sample]()
        for part in islice(self._parts, limit):
            if isinstance(part, Packed):
                break
            found.append(part)
        return Loose.some(found)

    def remove(self, count: int) -> None:
        """Remove the oldest `count` messages, which were sent."""
        self.count -= count
        while count:
            part = self._parts.popleft()
            if not isinstance(part, Packed):
                self.bytes -= len(part.payload)
                count -= 1
                continue
            self.bytes -= part.payload_bytes
            if count < part.count:
                rest = part.after(count)
                self.bytes += rest.payload_bytes
                self._parts.appendleft(rest)
            count -= min(count, part.count)

    def clear(self) -> int:
        """Remove all messages; returns their number."""
        count = self.count
        self._parts.clear()
        self.count = self.bytes = 0
        return count


class RateLimit:
    """Lets at most `hz` messages in a second pass, by the time of their publication."""

    def __init__(self, hz: float) -> None:
        self._period_ns = int(_NS_PER_S / hz)
        self._slack_ns = int(self._period_ns * _SLACK)
        self._due_ns = -_NEVER_NS

    def passing(self, samples: Iterable[Sample]) -> list[Sample]:
        """The messages of `samples`, in order, that may pass."""
        return [sample for sample in samples if self._passes(sample.source_time_ns)]

    def _passes(self, time_ns: int) -> bool:
        late_ns = time_ns - self._due_ns
        if -2 * self._period_ns <= late_ns < -self._slack_ns:
            return False
        # After a message on time, the schedule continues from the due time. So the mean rate is exact. After
        # a pause, or if the publisher's clock was set back, the schedule starts again.
        is_on_time = -self._slack_ns <= late_ns < self._period_ns
        self._due_ns = (self._due_ns if is_on_time else time_ns) + self._period_ns
        return True
