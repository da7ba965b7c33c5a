"""Many small messages of one publisher in one buffer, the same from taking to sending and publishing. Pure.

An object for each message would cost more than everything else. So messages stay together from the tap to
zenoh and from zenoh to the mirror, unless single messages must be handled.
"""

from collections.abc import Iterator
from struct import Struct
from typing import NamedTuple

from bus import shm
from bus.subscription import Pack
from bus_bridge.batch import Batch, Sample

__all__ = ["RECORD", "Packed", "scan"]

RECORD = Struct("<QqI")
"""The head of each message: its number, its source time, its size."""
_HEAD = Struct("<Qq")
_ALL = 1 << 62
_LARGEST = (1 << 64) - 1


class Scan(NamedTuple):
    """The contents of a buffer of records."""

    records: int
    stop: int
    """The end of the last record."""
    payload_bytes: int
    highest: int
    """The highest number."""
    last_at: int
    """The beginning of the last record."""
    is_consecutive: bool
    """Whether the numbers are consecutive."""


class Packed(Batch):
    """A batch in one buffer."""

    __slots__ = ("_last_at", "size", "start", "whole")

    def __init__(
        self, whole: bytes, start: int, count: int, payload_bytes: int, last_at: int, is_consecutive: bool
    ) -> None:
        self.whole = whole
        """The buffer; the samples begin at byte `start` of it."""
        self.start = start
        self.size = len(whole) - start
        """Size of the records in bytes."""
        self.count = count
        self.payload_bytes = payload_bytes
        self._last_at = last_at
        self.is_consecutive = is_consecutive
        self.last_number, self.last_time_ns = _HEAD.unpack_from(whole, last_at)
        self.first_number = self.last_number if last_at == start else _HEAD.unpack_from(whole, start)[0]

    @classmethod
    def taken(cls, pack: Pack) -> "Packed":
        return cls(pack.data, 0, pack.messages, pack.payload_bytes, pack.last_at, pack.is_consecutive)

    @classmethod
    def read(cls, data: bytes, most_number: int) -> "Packed | None":
        """Read a buffer of records; None if it has anything else, or if a number is above `most_number`."""
        records, stop, payload_bytes, highest, last_at, is_consecutive = _scan(data, 0, _ALL)
        if not records or stop != len(data) or highest > most_number:
            return None
        return cls(data, 0, records, payload_bytes, last_at, is_consecutive)

    def after(self, count: int) -> "Packed":
        if not count:
            return self
        gone = scan(self.whole, self.start, count)
        left, size = self.count - count, self.payload_bytes - gone.payload_bytes
        return Packed(self.whole, gone.stop, left, size, self._last_at, self.is_consecutive)

    def __iter__(self) -> Iterator[Sample]:
        whole, at, head, size = self.whole, self.start, RECORD.unpack_from, RECORD.size
        for _ in range(self.count):
            number, source_time_ns, length = head(whole, at)
            at += size
            yield Sample(whole[at : at + length], number, source_time_ns)
            at += length


def scan(data: bytes, start: int, limit: int) -> Scan:
    """Scan the first `limit` records from byte `start` on; stops before anything that is not a record."""
    return Scan(*_scan(data, start, limit))


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


_scan = shm.native.scan_packed if shm.has_core() else scan_here  # checked once: a check costs like a scan
