"""The attachment of each message, request and answer: a number, a time, and a gid. Pure."""

import struct
from typing import Final, NamedTuple

__all__ = ["GID_BYTES", "Attachment", "read", "write"]

GID_BYTES: Final = 16
_NUMBERS: Final = struct.Struct("<qq")
_WHOLE: Final = struct.Struct("<qqB16s")
_SIZES: Final = (_WHOLE.size, _NUMBERS.size + GID_BYTES)
"""With the length of the gid, as in Jazzy and Kilted, and without, as some other programs write it."""


class Attachment(NamedTuple):
    """The content of an attachment."""

    number: int
    """The number of a message of its publisher, from 1. In a request and its answer: the number of the
    client's request."""
    time_ns: int
    """Time of sending: wall clock of the sender's machine."""
    gid: bytes
    """The gid of the publisher; in a request and its answer: the gid of the client."""


def write(number: int, time_ns: int, gid: bytes) -> bytes:
    """The 33 bytes of an attachment."""
    return _WHOLE.pack(number, time_ns, GID_BYTES, gid)


def read(data: bytes) -> Attachment | None:
    """The content of an attachment; None if the bytes are not one."""
    size = len(data)
    if size not in _SIZES or (size == _WHOLE.size and data[_NUMBERS.size] != GID_BYTES):
        return None
    number, time_ns = _NUMBERS.unpack_from(data)
    return Attachment(number, time_ns, data[-GID_BYTES:])
