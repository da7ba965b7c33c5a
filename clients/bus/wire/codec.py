"""Control messages into frames, and out of the bodies of frames.

Owns the refusal of what is none; must not know the messages but for their base.
"""

from typing import Any

import msgspec

from bus.errors import RemoteProtocolError
from bus.wire.layout import CONTROL, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES

_encode = msgspec.msgpack.Encoder().encode


class Message(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="m", tag=True):
    """Base of all control messages."""


def encode_frame(message: msgspec.Struct) -> bytes:
    """The whole control frame that carries `message`."""
    body = _encode(message)
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


class Decoder:
    """Decodes the control messages that one role may send (`union`); one for each role is enough."""

    def __init__(self, union: Any) -> None:
        self._decode = msgspec.msgpack.Decoder(union).decode

    def decode(self, body: bytes) -> Any:
        """Raises RemoteProtocolError, naming the field, where `body` is no message of that role."""
        try:
            return self._decode(body)
        except (ValueError, RecursionError) as error:  # msgspec's errors and bad UTF-8 are ValueErrors
            raise RemoteProtocolError(f"control message not understood: {error}") from None
