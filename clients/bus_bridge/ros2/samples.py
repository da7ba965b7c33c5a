"""The payload of a sample: CDR. For RTPS its length is a multiple of four. Pure."""

from bus_ros.cdr import Codec

__all__ = ["encode", "joined", "padded"]


def encode(codec: Codec, message: bytes) -> bytes:
    """The payload for a message of the bus. Raises CdrError."""
    parts = codec.encode(message)
    if padding := -sum(map(len, parts)) % 4:
        parts.append(bytes(padding))
    return b"".join(parts)


def joined(codec: Codec, message: bytes) -> bytes:
    """The CDR of a message of the bus, without padding at its end. Raises CdrError."""
    return b"".join(codec.encode(message))


def padded(cdr: bytes) -> bytes:
    return cdr + bytes(-len(cdr) % 4)
