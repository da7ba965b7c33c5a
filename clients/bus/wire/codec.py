"""Encodes control messages to frames, and decodes them from the bodies of frames.

Refuses bodies that are no message. Knows only the base class of the messages.
"""

from collections.abc import Callable
from functools import cached_property
from struct import Struct
from typing import Any

import msgspec

from bus.errors import RemoteProtocolError
from bus.wire.layout import CONTROL, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES

_encode = msgspec.msgpack.Encoder().encode

# MessagePack's fixarray and array 32.
_SHORT_ARRAY, _SHORT_ARRAY_TAG = 16, 0x90
_ARRAY_HEAD, _ARRAY_TAG = Struct(">BI"), 0xDD


class Message(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="m", tag=True, gc=False):
    """Base of all control messages.

    The garbage collector ignores them: there may be many, and none is part of a cycle.
    """


def encode_frame(message: msgspec.Struct) -> bytes:
    """The whole control frame with `message`."""
    body = _encode(message)
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


class ArrayEncoder:
    """Encodes a long array a few items at a time, for a field of a message."""

    def __init__(self) -> None:
        self._body = bytearray()
        self._count = 0

    def extend(self, items: list[Any]) -> None:
        """Add `items`, fewer than 65,536."""
        self._body += memoryview(_encode(items))[1 if len(items) < _SHORT_ARRAY else 3 :]
        self._count += len(items)

    def raw(self) -> msgspec.Raw:
        """The encoded array, for use as the field's value."""
        if self._count < _SHORT_ARRAY:
            return msgspec.Raw(bytes([_SHORT_ARRAY_TAG | self._count]) + self._body)
        return msgspec.Raw(_ARRAY_HEAD.pack(_ARRAY_TAG, self._count) + self._body)


class Decoder:
    """Decodes the control messages that one role may send (`union`). Each role needs one decoder."""

    def __init__(self, union: Any) -> None:
        self._union = union

    @cached_property
    def _decode(self) -> Callable[[bytes], Any]:
        """The decoding function, made at its first use: a client never uses the broker's decoder."""
        return msgspec.msgpack.Decoder(self._union).decode

    def decode(self, body: bytes) -> Any:
        """Decode a message.

        Raises RemoteProtocolError, naming the field, if `body` is no message of the role.
        """
        try:
            return self._decode(body)
        except (ValueError, RecursionError) as error:  # msgspec's errors and bad UTF-8 are ValueErrors
            raise RemoteProtocolError(f"control message not understood: {error}") from None
