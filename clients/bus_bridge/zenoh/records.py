"""The form of messages in zenoh: several small ones in one part, a large one in several parts. Pure.

A part is the contents of one put. It begins with a head, in the put's attachment: its kind, and its number in
the route, from 1. The kinds:

- a batch: records one after the other: number u64, source time i64 (wall clock, ns), size u32, payload;
- a whole message: the head has its number and source time, the payload is unchanged;
- a piece of a large message: the head also has the message's size and the piece's position, u64 each;
- a probe, without payload and with the number of the part before it: it asks for the importer's progress.

The answer to a probe is an ack with two u64: the number of the newest part that has arrived, and the number
of the newest part with all its messages taken. A request for kept messages also has two u64. It asks for the
part after the message with this number, from that byte on. All numbers are little-endian.
"""

from collections.abc import Iterable
from struct import Struct
from typing import NamedTuple

from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import LONG_BYTES, LONG_PACK_BYTES, PACK_BYTES
from bus_bridge.packed import RECORD, Packed

__all__ = [
    "MAX_MESSAGE_BYTES",
    "MAX_NUMBER",
    "PART_BYTES",
    "WHOLE_BYTES",
    "Assembler",
    "Part",
    "Piece",
    "Probe",
    "Room",
    "pack",
    "piece",
    "probe",
    "read_pair",
    "read_part",
    "write_pair",
]

PART_BYTES = PACK_BYTES
"""With its key and zenoh's own heads, a part fits into one of zenoh's batches. These have 64 KiB, rounded
down to a multiple of half a TCP segment: on loopback, 48 KiB are left. A part that zenoh has to cut costs a
quarter more."""
WHOLE_BYTES = LONG_PACK_BYTES
"""Up to this size, one or several messages may use one put, which zenoh cuts itself. Pieces cost two more
copies, and each put wakes every thread on its way."""
MAX_MESSAGE_BYTES = 1 << 30
MAX_NUMBER = (1 << 48) - 1
"""The highest number of a message, and of a part: a million a second for nine years. Higher numbers are
forged, and would break counters."""

_HEAD = Struct("<cQ")
_WHOLE = Struct("<cQQq")
_PIECE = Struct("<cQQqQQ")
_PAIR = Struct("<QQ")
_BATCH_KIND, _WHOLE_KIND, _PIECE_KIND, _PROBE_KIND = b"b", b"w", b"p", b"?"


class Part(NamedTuple):
    """The contents of one put."""

    payload: bytes
    number: int
    """Its number in the route, from 1."""
    head: bytes


class Piece(NamedTuple):
    """Bytes of a message that is larger than a part."""

    number: int
    source_time_ns: int
    total: int
    offset: int
    payload: bytes


class Probe(NamedTuple):
    """A question for the importer's progress, without a message."""


Content = Batch | Piece | Probe


def pack(samples: Iterable[Sample], number: int, most: int = WHOLE_BYTES) -> list[Part]:
    """The parts that carry `samples`; `number` is the number of the first part.

    A part that zenoh has to cut has at most `most` bytes, which must not be below `PART_BYTES`.
    """
    if samples.__class__ is Packed and samples.size <= most:  # already a batch
        return [Part(samples.whole[samples.start :], number, _HEAD.pack(_BATCH_KIND, number))]
    found = list[Part]()
    record, parts, size = RECORD.pack, list[bytes](), 0
    for sample in samples:
        payload, message, source_time_ns = sample
        length = len(payload)
        if parts and (length >= LONG_BYTES or size + length + RECORD.size > PART_BYTES):
            found.append(Part(b"".join(parts), number, _HEAD.pack(_BATCH_KIND, number)))
            parts, size, number = [], 0, number + 1
        if length < LONG_BYTES:
            parts += (record(message, source_time_ns, length), payload)
            size += length + RECORD.size
        elif length <= most:
            found.append(Part(payload, number, _WHOLE.pack(_WHOLE_KIND, number, message, source_time_ns)))
            number += 1
        else:
            for offset in range(0, length, PART_BYTES):
                found.append(piece(sample, offset, number))
                number += 1
    if parts:
        found.append(Part(b"".join(parts), number, _HEAD.pack(_BATCH_KIND, number)))
    return found


def piece(sample: Sample, offset: int, number: int) -> Part:
    """The piece of a large message that begins at byte `offset`."""
    payload, message, source_time_ns = sample
    head = _PIECE.pack(_PIECE_KIND, number, message, source_time_ns, len(payload), offset)
    return Part(payload[offset : offset + PART_BYTES], number, head)


def probe(last: int) -> Part:
    """A question to the importers; `last`: the number of the newest part."""
    return Part(b"", last, _HEAD.pack(_PROBE_KIND, last))


def read_part(payload: bytes, head: bytes | None) -> tuple[int, Content] | None:
    """A part's number and contents; None if the part is broken, or not in the form of `pack`."""
    kind, size = (head[:1], len(head)) if head else (b"", 0)
    if head is None or size < _HEAD.size or len(payload) > WHOLE_BYTES:
        return None
    number: int = _HEAD.unpack_from(head)[1]
    if number > MAX_NUMBER:
        return None
    if kind == _BATCH_KIND and size == _HEAD.size:
        found = Packed.read(payload, MAX_NUMBER)
        return None if found is None else (number, found)
    if kind == _WHOLE_KIND and size == _WHOLE.size:
        _, _, message, source_time_ns = _WHOLE.unpack(head)
        return None if message > MAX_NUMBER else (number, Loose([Sample(payload, message, source_time_ns)]))
    if kind == _PIECE_KIND and size == _PIECE.size:
        _, _, message, source_time_ns, total, offset = _PIECE.unpack(head)
        if offset % PART_BYTES or len(payload) != min(PART_BYTES, total - offset) or not payload:
            return None
        if total > MAX_MESSAGE_BYTES or message > MAX_NUMBER:
            return None
        return number, Piece(message, source_time_ns, total, offset, payload)
    if kind == _PROBE_KIND and size == _HEAD.size and not payload:
        return number, Probe()
    return None


class Room:
    """Bytes that incomplete data may use in all routes in together. A far side may start any number of large
    messages and complete none."""

    def __init__(self, size: int) -> None:
        self.left = size

    def take(self, size: int) -> bool:
        """Take `size` bytes if there is room; returns whether there was."""
        if size > self.left:
            return False
        self.left -= size
        return True

    def give(self, size: int) -> None:
        self.left += size


class Assembler:
    """Joins pieces, which come in order. It handles one message at a time, and drops a message without
    `room`."""

    def __init__(self, room: Room) -> None:
        self._room = room
        self.size = 0
        """Number of bytes of an incomplete message."""
        self.left_out = 0
        """Number of the last message that had no room."""
        self._number = 0
        self._pieces: list[bytes] = []

    def add(self, part: Piece) -> Sample | None:
        """Add a piece; returns the message after its last piece. If a piece does not continue the message,
        both are dropped."""
        if part.offset == 0 or part.number != self._number or part.offset != self.size:
            self.clear()
            self._number = part.number
            if part.offset:
                return None
        if not self._room.take(len(part.payload)):
            self.clear()
            self.left_out = part.number
            return None
        self._pieces.append(part.payload)
        self.size += len(part.payload)
        if self.size < part.total:
            return None
        whole = b"".join(self._pieces)
        self.clear()
        return Sample(whole, part.number, part.source_time_ns)

    def clear(self) -> None:
        """Drop an incomplete message."""
        self._room.give(self.size)
        self._pieces, self.size = [], 0


def write_pair(first: int, second: int) -> bytes:
    return _PAIR.pack(first, second)


def read_pair(data: bytes | None) -> tuple[int, int] | None:
    """Read two u64; None if `data` has another form."""
    return _PAIR.unpack(data) if data is not None and len(data) == _PAIR.size else None
