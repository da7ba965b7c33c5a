"""The payload of a sample: CDR, with a length that is a multiple of four. RTPS wants that. Pure."""

from bus_ros.cdr import Codec

__all__ = ["encode", "padded"]


def encode(codec: Codec, message: bytes) -> bytes:
    """The payload for a message of the bus. Raises CdrError."""
    parts = codec.encode(message)
    if padding := -sum(map(len, parts)) % 4:
        parts.append(bytes(padding))
    return b"".join(parts)


def padded(cdr: bytes) -> bytes:
    return cdr + bytes(-len(cdr) % 4)
