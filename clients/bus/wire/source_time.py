"""The source's time in front of a payload, if that is not the time of publishing.

16 bytes: a mark, then nanoseconds of the wall clock (i64). The mark is the head of a MessagePack extension,
with which no message begins, so the bytes can't be part of a message. `bus.shm` knows them, too (py.h).
"""

from struct import Struct

from bus.errors import ConfigurationError

SOURCE_MARK = b"\xc7\x0d\x54\0\0\0\0\0"
SOURCE_BYTES = 16
_head = Struct("<8sq")


def source_head(source_ns: int) -> bytes:
    """The bytes for a source time. Raises ConfigurationError if the number is no time."""
    if not isinstance(source_ns, int) or not 0 < source_ns < 1 << 63:
        raise ConfigurationError(f"source_time_ns is nanoseconds since 1970, above 0; it is {source_ns!r}")
    return _head.pack(SOURCE_MARK, source_ns)


def source_ns_of(payload: bytes | bytearray | memoryview) -> int:
    """The source time in front of a payload; 0 if the payload is only a message."""
    if len(payload) <= SOURCE_BYTES or payload[:8] != SOURCE_MARK:
        return 0
    source_ns: int = _head.unpack_from(payload)[1]
    return max(source_ns, 0)
