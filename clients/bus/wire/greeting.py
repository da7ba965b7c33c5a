"""Reads only a client's Hello from the stream, and none of the bytes after it.

With it, a broker holds nothing else of a new connection. Bytes in, a Hello out; no I/O.
"""

from bus.errors import RemoteProtocolError
from bus.wire.layout import CONTROL, DATA, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES
from bus.wire.messages import Hello, from_client
from bus.wire.session import Role, check_version

__all__ = ["MAX_HELLO_BYTES", "Greeting"]

MAX_HELLO_BYTES = 32 << 10
"""Longest body of a Hello's frame. Its texts have bounds that keep it shorter."""

_unpack_head = FRAME_HEAD.unpack_from
_decode = from_client.decode


class Greeting:
    """Collects the bytes of a Hello. `wanted`: the most bytes to read next, and to pass to `received`."""

    __slots__ = ("_bytes", "_length", "wanted")

    def __init__(self) -> None:
        self.wanted = FRAME_HEAD_BYTES
        self._bytes = b""
        self._length = 0

    def received(self, more: bytes) -> Hello | None:
        """Take more bytes; returns the Hello when it is complete.

        Raises RemoteProtocolError if the bytes are no Hello, or a Hello of another version.
        """
        self._bytes += more
        self.wanted -= len(more)
        if not self.wanted and not self._length:
            self._length = self.wanted = _body_bytes(self._bytes)
        if self.wanted:
            return None
        message = _decode(self._bytes[FRAME_HEAD_BYTES:])
        if not isinstance(message, Hello):
            raise RemoteProtocolError(f"a {type(message).__name__} came before Hello")
        check_version(message, Role.BROKER)
        return message


def _body_bytes(head: bytes) -> int:
    """The length of a control frame's body, read from its head."""
    length, kind, flags, zero = _unpack_head(head)
    if kind == DATA:
        raise RemoteProtocolError("a data frame came before Hello")
    if kind != CONTROL:
        raise RemoteProtocolError(f"frame of unknown kind {kind}")
    if zero or flags:
        raise RemoteProtocolError(f"frame with unknown flags {flags:#x}")
    rest = FRAME_HEAD_BYTES - LENGTH_BYTES
    if not rest < length <= rest + MAX_HELLO_BYTES:
        raise RemoteProtocolError(
            f"frame of {length} bytes; that of a Hello has {rest + 1} to {rest + MAX_HELLO_BYTES}"
        )
    return int(length) - rest
