"""What a publisher's way out keeps: what is on its way, and its history for late joiners. Pure.

zenoh drops where its own queues are full. So of a reliable route everything stays here until each importer's
bridge has got it; an importer that misses something asks for it. How many bytes may be under way shrinks when
that happens, and grows again, as TCP's window does: what has no room waits with the caller. A lossless route
also waits until each importer's bus has taken its messages, and never has more than `WINDOW_BYTES` under way.
An importer that has gone is waited for no more.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from itertools import islice

from bus_bridge.engine import Sample
from bus_bridge.zenoh.records import BATCH_BYTES

__all__ = ["HISTORY_BYTES", "WINDOW_BYTES", "Kept"]

WINDOW_BYTES = 4 << 20
HISTORY_BYTES = 32 << 20
_FIRST_SPAN = 512 << 10
_LEAST_SPAN = 64 << 10
_RECORD = 20  # bytes that a message costs besides its payload


class _Importer:
    def __init__(self, number: int) -> None:
        self.joined = self.arrived = self.taken = number


class Kept:
    """`reliable`: messages are kept until every importer has got them; `lossless`: or taken. `history`: so
    many of the last ones are kept for late joiners, `HISTORY_BYTES` at most (and one message always)."""

    def __init__(self, *, reliable: bool, lossless: bool = False, history: int = 0) -> None:
        self.last = 0
        """Number of the newest message."""
        self._reliable = reliable
        self._lossless = lossless
        self._depth = history
        self._history: deque[Sample] = deque()
        self._history_bytes = 0
        self._flying = _Flying()
        self._importers: dict[str, _Importer] = {}
        self._span = self._threshold = _FIRST_SPAN
        """Bytes that may be between the bridges."""
        self._shrunk_at = 0
        self._unasked = 0

    @property
    def in_flight(self) -> int:
        """Bytes that some importer has not got yet, or of a lossless route its bus has not taken."""
        return self._flying.size

    @property
    def has_arrived(self) -> bool:
        """Whether every importer's bridge has got everything."""
        return all(one.arrived >= self.last for one in self._importers.values())

    def fitting(self, samples: Sequence[Sample]) -> int:
        """How many of `samples`, from the front, may go now. A message that is larger goes alone."""
        if not self._reliable or not self._importers:
            return len(samples)
        travelling = self._travelling()
        room = min(WINDOW_BYTES - self._flying.size, self._span - travelling)
        is_free = not travelling
        for index, sample in enumerate(samples):
            size = len(sample.payload) + _RECORD
            if size > room and (index or not is_free or self._flying.size + size > WINDOW_BYTES > size):
                return index
            room -= size
        return len(samples)

    def add(self, samples: Sequence[Sample]) -> None:
        """They are on their way."""
        if not samples:
            return
        self.last = samples[-1].number
        if self._reliable and self._importers:
            before = self._flying.size
            self._flying.add(samples)
            self._unasked += self._flying.size - before
        if self._depth:
            self._history += samples
            self._history_bytes += sum(len(one.payload) for one in samples)
            while len(self._history) > self._depth or (
                self._history_bytes > HISTORY_BYTES and len(self._history) > 1
            ):
                self._history_bytes -= len(self._history.popleft().payload)

    def must_ask(self) -> bool:
        """Whether the importers should be asked how far they are: four times in a span. Then they are."""
        if self._unasked * 4 < self._span:
            return False
        self._unasked = 0
        return True

    # --- importers

    def join(self, importer: str) -> None:
        """It takes what comes from now on."""
        self._importers[importer] = _Importer(self.last)

    def leave(self, importer: str) -> None:
        if self._importers.pop(importer, None) is not None:
            self._release()

    def hear(self, importer: str, arrived: int, taken: int) -> bool:
        """Its bridge has got everything up to `arrived`, and its bus has taken it up to `taken`. Whether that
        was news. Numbers that were never sent count as the newest."""
        known = self._importers.get(importer)
        if known is None:
            return False
        arrived = max(known.arrived, min(arrived, self.last))
        taken = max(known.taken, min(taken, arrived))
        if (arrived, taken) == (known.arrived, known.taken):
            return False
        before = self._travelling()
        known.arrived, known.taken = arrived, taken
        self._grow(before - self._travelling())
        self._release()
        return True

    def _travelling(self) -> int:
        """Bytes that some importer's bridge has not got yet."""
        return self._flying.size_after(min(one.arrived for one in self._importers.values()))

    def _grow(self, gone: int) -> None:
        if self._span < self._threshold:
            self._span = min(self._span + gone, WINDOW_BYTES)
        else:
            self._span = min(self._span + gone * _LEAST_SPAN // self._span, WINDOW_BYTES)

    def _shrink(self) -> None:
        """Something was dropped: less at a time, once for all that was under way."""
        if min((one.arrived for one in self._importers.values()), default=0) >= self._shrunk_at:
            self._shrunk_at = self.last
            self._span = self._threshold = max(self._span // 2, _LEAST_SPAN)

    def _release(self) -> None:
        importers = self._importers.values()
        ends = (one.taken for one in importers) if self._lossless else (one.arrived for one in importers)
        self._flying.drop(min(ends, default=self.last))

    # --- what somebody lacks

    def find(self, importer: str, after: int) -> Sequence[Sample] | None:
        """The first messages after the number `after` that are kept for it, about a batch of them, and at
        least one where there is any; None where it is no importer."""
        known = self._importers.get(importer)
        if known is None:
            return None
        if self._reliable and known.joined < after < self.last:
            self._shrink()
        if not self._depth:
            return self._flying.after(max(after, known.joined))
        if self._flying and self._history and self._flying.first < self._history[0].number:
            return self._flying.after(after)
        start = sum(1 for sample in self._history if sample.number <= after)
        return _piece(islice(self._history, start, None))


class _Flying:
    """Messages in the order of their numbers, and how many bytes there are after one of them."""

    def __init__(self) -> None:
        self.size = 0
        self._samples: list[Sample] = []
        self._ends: list[int] = []
        self._numbers: list[int] = []
        self._start = 0  # those before have been dropped
        self._end = 0

    def __bool__(self) -> bool:
        return self._start < len(self._samples)

    @property
    def first(self) -> int:
        return self._numbers[self._start]

    def add(self, samples: Sequence[Sample]) -> None:
        end = self._end
        for sample in samples:
            end += len(sample.payload) + _RECORD
            self._ends.append(end)
            self._numbers.append(sample.number)
        self._samples += samples
        self.size += end - self._end
        self._end = end

    def size_after(self, number: int) -> int:
        index = self._index(number)
        return self.size if index == self._start else self._end - self._ends[index - 1]

    def drop(self, number: int) -> None:
        """Those up to `number`."""
        index = self._index(number)
        if index == len(self._samples):
            self._samples, self._ends, self._numbers, self._start, self.size = [], [], [], 0, 0
            return
        self.size = self.size_after(number)
        for gone in range(self._start, index):
            self._samples[gone] = _GONE
        self._start = index
        if index > len(self._samples) // 2:
            del self._samples[:index], self._ends[:index], self._numbers[:index]
            self._start = 0

    def after(self, number: int) -> list[Sample]:
        return _piece(islice(self._samples, self._index(number), None))

    def _index(self, number: int) -> int:
        return bisect_right(self._numbers, number, self._start)


_GONE = Sample(b"", 0, 0)


def _piece(samples: "islice[Sample]") -> list[Sample]:
    found, size = list[Sample](), 0
    for sample in samples:
        size += len(sample.payload) + _RECORD
        if found and size > BATCH_BYTES:
            break
        found.append(sample)
    return found
