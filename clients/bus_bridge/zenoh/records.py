"""Messages as they go through zenoh: several small ones in one put, a large one in a put of its own. Pure.

A put of a batch has records back to back: number u64, source time i64 (wall clock, ns), size u32, payload.
A put of one large message has the payload as it is, and number and source time in its attachment. Reliable
routes have `previous`, the number of the message before the put's first, at the end of the attachment. An
empty payload with only that is a question: how far are you? The answer, a word, has two u64, the numbers of
the newest message that has arrived and of the newest that was taken. All little-endian.
"""

from collections.abc import Iterator, Sequence
from struct import Struct
from typing import NamedTuple

from bus_bridge.engine import Sample

__all__ = [
    "BATCH_BYTES",
    "Put",
    "count",
    "pack",
    "probe",
    "read_number",
    "unpack",
    "write_number",
]

BATCH_BYTES = 60 << 10
"""Of a batch: with its key and zenoh's own heads it fits into one of zenoh's batches of 64 KiB."""
_ALONE_BYTES = 16 << 10  # from here on, the copy into a batch costs more than a put

_HEAD = Struct("<QqI")
_ALONE = Struct("<Qq")
_NUMBER = Struct("<Q")
_WORD = Struct("<QQ")


class Put(NamedTuple):
    payload: bytes
    attachment: bytes | None


def pack(
    samples: Sequence[Sample], previous: int | None = None, alone_bytes: int = _ALONE_BYTES
) -> Iterator[Put]:
    """The puts that carry `samples`; `previous`: the number before the first, for reliable routes. From
    `alone_bytes` on, a message has a put of its own."""
    head, parts, size = _HEAD.pack, list[bytes](), 0
    before, mark = previous or 0, previous is not None
    last = before
    for payload, number, source_time_ns in samples:
        length = len(payload)
        if parts and (length >= alone_bytes or size + length + _HEAD.size > BATCH_BYTES):
            yield Put(b"".join(parts), _NUMBER.pack(before) if mark else None)
            parts, size, before = [], 0, last
        if length >= alone_bytes:
            alone = _ALONE.pack(number, source_time_ns)
            yield Put(payload, alone + _NUMBER.pack(before) if mark else alone)
            before = number
        else:
            parts += (head(number, source_time_ns, length), payload)
            size += length + _HEAD.size
        last = number
    if parts:
        yield Put(b"".join(parts), _NUMBER.pack(before) if mark else None)


def probe(last: int) -> Put:
    """No message, but a question to those who take; `last`: the number of the newest message."""
    return Put(b"", _NUMBER.pack(last))


def is_probe(payload: bytes, attachment: bytes | None) -> bool:
    return not payload and attachment is not None and len(attachment) == _NUMBER.size


def unpack(payload: bytes, attachment: bytes | None, *, marked: bool) -> tuple[list[Sample], int] | None:
    """The messages of a put, and `previous` (0 where the route is not `marked`); None where it is broken."""
    rest, previous = attachment or b"", 0
    if marked:
        if len(rest) < _NUMBER.size:
            return None
        rest, previous = rest[: -_NUMBER.size], _NUMBER.unpack(rest[-_NUMBER.size :])[0]
    if rest:
        if len(rest) != _ALONE.size:
            return None
        number, source_time_ns = _ALONE.unpack(rest)
        return [Sample(payload, number, source_time_ns)], previous
    found = _records(payload)
    return None if found is None else (found, previous)


def _records(payload: bytes) -> list[Sample] | None:
    head, start, end, found = _HEAD.unpack_from, 0, len(payload), list[Sample]()
    last_head = end - _HEAD.size
    while start <= last_head:
        number, source_time_ns, size = head(payload, start)
        start += _HEAD.size
        stop = start + size
        found.append(Sample(payload[start:stop], number, source_time_ns))
        start = stop
    return found if start == end else None


def count(payload: bytes, attachment: bytes | None, *, marked: bool) -> int:
    """How many messages a put has; 0 where it is broken."""
    found = unpack(payload, attachment, marked=marked)
    return 0 if found is None else len(found[0])


def write_number(number: int) -> bytes:
    return _NUMBER.pack(number)


def read_number(data: bytes) -> int | None:
    """None where that is no number."""
    return int(_NUMBER.unpack(data)[0]) if len(data) == _NUMBER.size else None


def write_word(arrived: int, taken: int) -> bytes:
    return _WORD.pack(arrived, taken)


def read_word(data: bytes) -> tuple[int, int] | None:
    """None where that is no word."""
    return _WORD.unpack(data) if len(data) == _WORD.size else None
