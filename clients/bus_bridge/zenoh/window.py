"""Parts that a publisher's route out keeps: parts on their way, and its history for late joiners. Pure.

zenoh drops parts if its queues are full. So all parts stay here until each importer's bridge has received
them. An importer asks for missing parts. Then the number of bytes that may be on their way shrinks; it grows
again later, like TCP's window. A lossless route also waits until each importer's bus has taken its messages,
and never has more than `WINDOW_BYTES` on their way. The route does not wait for an importer that has gone.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable

from bus_bridge.batch import Sample
from bus_bridge.zenoh.records import PART_BYTES, WHOLE_BYTES, Part, pack, piece

__all__ = ["HISTORY_BYTES", "WINDOW_BYTES", "History", "Window"]

WINDOW_BYTES = 4 << 20
HISTORY_BYTES = 32 << 20
_FIRST_SPAN = 512 << 10
_LEAST_SPAN = 2 * PART_BYTES
_STEP = 32 << 10  # growth of the span each time that a whole span has arrived
_PART = 64  # cost of a part in bytes, besides its payload


class _Importer:
    def __init__(self, number: int) -> None:
        self.joined = self.arrived = self.taken = number


class Window:
    """The parts of a route on their way; of a `lossless` route, until importers have taken them."""

    def __init__(self, *, lossless: bool) -> None:
        self.last = 0
        """Number of the newest part."""
        self._lossless = lossless
        self._flying = _Flying()
        self._travelling = 0
        """Bytes that at least one importer's bridge has not received yet."""
        self._importers: dict[str, _Importer] = {}
        self._span = _FIRST_SPAN
        """Bytes that may be between the bridges."""
        self._threshold = WINDOW_BYTES
        """Below this span, the span grows by all bytes that arrive, as in TCP's slow start; above it, step by
        step."""
        self._shrunk_at = 0
        self._unasked = 0

    @property
    def in_flight(self) -> int:
        """Bytes that at least one importer has not received yet; in a lossless route: that its bus has not
        taken yet."""
        return self._flying.size

    @property
    def room(self) -> int:
        """Bytes that may be sent now; 0 or less: none. A single part may be larger if this is above 0."""
        room = self._span - self._travelling
        return min(room, WINDOW_BYTES - self._flying.size) if self._lossless else room

    @property
    def part_bytes(self) -> int:
        """The size of a part now. On a slow link parts are small, because a dropped part is sent again as a
        whole and delays other parts."""
        return max(2 * PART_BYTES, min(WHOLE_BYTES, self._span // 4))

    def add(self, part: Part) -> bool:
        """Add a part that is sent now. Returns whether to ask the importers for their progress: four times in
        a span."""
        self.last = part.number
        if self._importers:
            size = len(part.payload) + _PART
            self._flying.add(part, size)
            self._travelling += size
            self._unasked += size
        if self._unasked * 4 < self._span:
            return False
        self._unasked = 0
        return True

    # --- importers

    def join(self, importer: str) -> None:
        """Add an importer, which takes parts from now on."""
        self._importers[importer] = _Importer(self.last)

    def leave(self, importer: str) -> None:
        if self._importers.pop(importer, None) is not None:
            self._release()
            self._measure()

    def joined(self, importer: str) -> int | None:
        """The number of the last part before an importer joined; None if it is not an importer."""
        known = self._importers.get(importer)
        return None if known is None else known.joined

    def acknowledge(self, importer: str, arrived: int, taken: int) -> bool:
        """Handle an ack: the importer's bridge has all parts up to `arrived`, and its bus has taken them up
        to `taken`.

        Returns whether that was news. Numbers that were never sent count as the newest.
        """
        known = self._importers.get(importer)
        if known is None:
            return False
        arrived = max(known.arrived, min(arrived, self.last))
        taken = max(known.taken, min(taken, arrived))
        if (arrived, taken) == (known.arrived, known.taken):
            return False
        before = self._travelling
        known.arrived, known.taken = arrived, taken
        self._release()
        self._grow(before - self._measure())
        return True

    def find(self, importer: str, after: int) -> Part | None:
        """The part after the number `after`, if it is kept."""
        known = self._importers.get(importer)
        if known is None:
            return None
        if known.joined <= after < self.last:
            self._shrink()
        return self._flying.after(max(after, known.joined))

    def _measure(self) -> int:
        """Update the counters; returns the number of bytes on their way."""
        least = min((one.arrived for one in self._importers.values()), default=self.last)
        self._travelling = self._flying.size_after(least)
        return self._travelling

    def _grow(self, gone: int) -> None:
        if self._span < self._threshold:
            self._span = min(self._span + gone, WINDOW_BYTES)
        else:
            self._span = min(self._span + gone * _STEP // self._span, WINDOW_BYTES)

    def _shrink(self) -> None:
        """Shrink the span after a dropped part: once for all parts that were on their way."""
        if min((one.arrived for one in self._importers.values()), default=0) >= self._shrunk_at:
            self._shrunk_at = self.last
            self._span = self._threshold = max(self._span // 2, _LEAST_SPAN)

    def _release(self) -> None:
        importers = self._importers.values()
        ends = (one.taken for one in importers) if self._lossless else (one.arrived for one in importers)
        self._flying.drop(min(ends, default=self.last))


class _Flying:
    """Parts in the order of their numbers, and the number of bytes after a part."""

    def __init__(self) -> None:
        self.size = 0
        self._parts: list[Part] = []
        self._ends: list[int] = []
        self._numbers: list[int] = []
        self._start = 0  # earlier parts have been dropped
        self._end = 0

    def add(self, part: Part, size: int) -> None:
        self._end += size
        self.size += size
        self._ends.append(self._end)
        self._numbers.append(part.number)
        self._parts.append(part)

    def size_after(self, number: int) -> int:
        index = self._index(number)
        return self.size if index == self._start else self._end - self._ends[index - 1]

    def drop(self, number: int) -> None:
        """Drop the parts up to `number`."""
        index = self._index(number)
        if index == len(self._parts):
            self._parts, self._ends, self._numbers, self._start, self.size = [], [], [], 0, 0
            return
        self.size = self.size_after(number)
        for gone in range(self._start, index):
            self._parts[gone] = _GONE
        self._start = index
        if index > len(self._parts) // 2:
            del self._parts[:index], self._ends[:index], self._numbers[:index]
            self._start = 0

    def after(self, number: int) -> Part | None:
        index = self._index(number)
        return self._parts[index] if index < len(self._parts) else None

    def _index(self, number: int) -> int:
        return bisect_right(self._numbers, number, self._start)


_GONE = Part(b"", 0, b"")


class History:
    """The last messages of a transient local publisher: at most `depth`, and at most `HISTORY_BYTES`, but
    always one."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._samples: deque[Sample] = deque()
        self._bytes = 0

    def add(self, samples: Iterable[Sample]) -> None:
        kept = self._samples
        kept += samples
        self._bytes += sum(len(one.payload) for one in samples)
        self._trim()

    def limit(self, depth: int) -> None:
        """Keep at most so many messages from now on."""
        self._depth = depth
        self._trim()

    def _trim(self) -> None:
        kept = self._samples
        while len(kept) > self._depth or (self._bytes > HISTORY_BYTES and len(kept) > 1):
            self._bytes -= len(kept.popleft().payload)

    @property
    def last(self) -> int:
        """Number of the newest message; 0 without one."""
        return self._samples[-1].number if self._samples else 0

    def find(self, after: int, offset: int, last: int) -> Part | None:
        """The part after the message with the number `after`: whole messages, or the piece at byte `offset`
        of the next message. None if there is nothing up to the message `last`."""
        found, size = list[Sample](), 0
        for sample in self._samples:
            if sample.number <= after:
                continue
            if sample.number > last:
                break
            if len(sample.payload) > PART_BYTES:
                if not found:
                    return piece(sample, offset if offset < len(sample.payload) else 0, 0)
                break
            size += len(sample.payload) + _PART
            if found and size > PART_BYTES:
                break
            found.append(sample)
        return pack(found, 0)[0] if found else None
