"""Many small messages of one publisher in one buffer, as they are taken, sent and published. Pure.

What would cost more than all else is to make an object of each message: so they stay together from the tap to
zenoh and from zenoh to the mirror, as long as nothing has to be done with single ones.
"""

from collections.abc import Iterator, Sequence
from struct import Struct
from typing import Literal, NamedTuple, overload

from bus import shm
from bus.subscription import Pack
from bus_bridge.engine import Sample

__all__ = ["RECORD", "Packed", "number_and_time", "payload_bytes", "scan"]

RECORD = Struct("<QqI")
"""In front of each message: its number, its source time, its size."""
_HEAD = Struct("<Qq")
_ALL = 1 << 62
_LARGEST = (1 << 64) - 1


class Scan(NamedTuple):
    """What stands in a buffer of records."""

    records: int
    stop: int
    """Where the last one ends."""
    payload_bytes: int
    highest: int
    """Number."""
    last_at: int
    """Where the last one begins."""
    is_consecutive: bool
    """Whether each has the number behind that of the one before it."""


class Packed(Sequence[Sample]):
    """Behaves as the list of its samples, and is never changed.

    `first` and `last` are the number and the source time of the first and the last one.
    """

    __slots__ = (
        "_count",
        "_last_at",
        "first",
        "is_consecutive",
        "last",
        "payload_bytes",
        "start",
        "whole",
    )

    def __init__(
        self, whole: bytes, start: int, count: int, payload_bytes: int, last_at: int, is_consecutive: bool
    ) -> None:
        self.whole = whole
        """The buffer; the samples begin at byte `start` of it."""
        self.start = start
        self._count = count
        self.payload_bytes = payload_bytes
        self._last_at = last_at
        self.is_consecutive = is_consecutive
        self.first = self.last = _HEAD.unpack_from(whole, start)
        if last_at != start:
            self.last = _HEAD.unpack_from(whole, last_at)

    @classmethod
    def taken(cls, pack: Pack) -> "Packed":
        return cls(pack.data, 0, pack.messages, pack.payload_bytes, pack.last_at, pack.is_consecutive)

    @classmethod
    def read(cls, data: bytes, most_number: int) -> "Packed | None":
        """None where that is not records and nothing else, or a number is higher."""
        found = scan(data, 0, _ALL)
        if not found.records or found.stop != len(data) or found.highest > most_number:
            return None
        return cls(data, 0, found.records, found.payload_bytes, found.last_at, found.is_consecutive)

    @property
    def data(self) -> bytes:
        """The records."""
        return self.whole[self.start :] if self.start else self.whole

    @property
    def size(self) -> int:
        """Bytes of the records."""
        return len(self.whole) - self.start

    def after(self, count: int) -> "Packed":
        """All but the first `count`; one is left at least."""
        if not count:
            return self
        gone = scan(self.whole, self.start, count)
        left, size = self._count - count, self.payload_bytes - gone.payload_bytes
        return Packed(self.whole, gone.stop, left, size, self._last_at, self.is_consecutive)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Sample]:
        whole, at, head, size = self.whole, self.start, RECORD.unpack_from, RECORD.size
        for _ in range(self._count):
            number, source_time_ns, length = head(whole, at)
            at += size
            yield Sample(whole[at : at + length], number, source_time_ns)
            at += length

    @overload
    def __getitem__(self, which: int) -> Sample: ...
    @overload
    def __getitem__(self, which: slice) -> Sequence[Sample]: ...

    def __getitem__(self, which: int | slice) -> Sample | Sequence[Sample]:
        if isinstance(which, slice):
            start, stop, step = which.indices(self._count)
            if (stop, step) == (self._count, 1):
                return self.after(start) if start < stop else []
            return list(self)[which]
        if which in (0, -1) and self._count:
            at = self._last_at if which else self.start
            number, source_time_ns, length = RECORD.unpack_from(self.whole, at)
            at += RECORD.size
            return Sample(self.whole[at : at + length], number, source_time_ns)
        return list(self)[which]


def scan(data: bytes, start: int, limit: int) -> Scan:
    """Look through the first `limit` records from byte `start` on; ends before what is none."""
    return Scan(*_scan_native(data, start, limit)) if _scan_native else scan_here(data, start, limit)


def scan_here(data: bytes, start: int, limit: int) -> Scan:
    """As `scan`, without the native core."""
    at, end, count, size, highest, last_at, due = start, len(data), 0, 0, 0, 0, None
    is_consecutive = True
    while count < limit and end - at >= RECORD.size:
        number, _, length = RECORD.unpack_from(data, at)
        if length > end - at - RECORD.size:
            break
        is_consecutive &= due in (None, number)
        due, highest, last_at = number + 1 & _LARGEST, max(highest, number), at
        at += RECORD.size + length
        size += length
        count += 1
    return Scan(count, at, size, highest, last_at, is_consecutive)


_scan_native = shm.native.scan_packed if shm.has_core() else None  # to ask each time costs as much as to scan


def payload_bytes(samples: Sequence[Sample]) -> int:
    """Of all of them together."""
    return samples.payload_bytes if type(samples) is Packed else sum([len(one[0]) for one in samples])


def number_and_time(samples: Sequence[Sample], which: Literal[0, -1]) -> tuple[int, int]:
    """The number and the source time of the first or the last of them, without a copy of the message."""
    if type(samples) is Packed:
        return samples.last if which else samples.first
    return samples[which][1:]
