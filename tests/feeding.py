"""Feeds bytes into a FrameReader or a Session, as a socket would. Knows nothing of messages."""

from collections.abc import Iterable, Iterator
from typing import Any

from bus.wire.framing import FrameReader
from bus.wire.layout import RECORD_HEAD
from bus.wire.session import Session


def frame_record(payload: bytes | bytearray | memoryview, stamp_ns: int) -> bytes:
    """One record: its head and its payload."""
    return b"".join((RECORD_HEAD.pack(len(payload), stamp_ns), payload))


def feed(receiver: FrameReader | Session, data: bytes, chunks: Iterable[int] = ()) -> Iterator[Any]:
    """The output of `receiver` for `data`, read in pieces of the given sizes, then in the largest ones."""
    reader = receiver.reader if isinstance(receiver, Session) else receiver
    sizes, at = iter(chunks), 0
    while at < len(data):
        buffer = reader.get_buffer()
        assert len(buffer) > 0
        count = min(len(buffer), len(data) - at, next(sizes, len(data)))
        buffer[:count] = data[at : at + count]
        at += count
        yield from receiver.received(count)
        while isinstance(receiver, FrameReader) and (frames := receiver.cut()):
            yield from frames
        if isinstance(receiver, FrameReader) and receiver.fault is not None:
            raise receiver.fault
