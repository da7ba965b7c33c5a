"""The codec of one type: its definition, and the conversion of messages in both directions.

Owns: `Codec`, one for each type in a process. Its functions are generated at their first use.
"""

import struct
from collections.abc import Callable, Iterable
from typing import Any, Final

import msgspec

from bus.errors import BusError
from bus.schema import MessageSchema
from bus.types.hash import schema_hash
from bus.types.schema import build
from bus.wire.runs import Buffer
from bus_ros.cdr.decoder import REPRESENTATIONS, decoder
from bus_ros.cdr.definition import parse, write
from bus_ros.cdr.encoder import LONG, encoder
from bus_ros.cdr.shapes import Message, describe

__all__ = ["CdrError", "Codec", "codec_of", "schema_of_definition"]

_pack: Final = msgspec.msgpack.Encoder().encode
_MOST_CODECS: Final = 1024
_WRONG: Final = (struct.error, ValueError, TypeError, OverflowError, RecursionError, MemoryError)


class CdrError(BusError, ValueError):
    """Bytes that are not a message of the type."""


class Codec:
    """Turns MessagePack payloads of one type into CDR messages, and back.

        codec = codec_of(subscription.schema)
        parts = codec.encode(payload)
        assert codec.decode(b"".join(parts)) == payload

    May be used from any thread.
    """

    type_name: str
    """The name in ROS 2: `sensor_msgs/msg/Imu`. Your own types may get a different name than on the bus."""
    type_hash: str
    """RIHS01 of `definition`: the schema's own hash, if ROS 2 can describe the type."""
    definition: str
    """The text of the type and of all types that it needs, as bag files have it ("ros2msg")."""
    as_json: tuple[str, ...]
    """The fields that ROS 2 can't describe, such as `local/msg/Wheel.extra`: JSON texts in CDR."""
    shape: Message
    """The encoding of the type, for other encoders of it."""

    def __init__(self, schema: MessageSchema) -> None:
        description = schema.description
        build(description)  # raises if the description is malformed or too large
        described = describe(description)
        self.type_name = described.schema["root"]
        self.type_hash = schema_hash(described.schema)
        self.definition = write(described.schema)
        self.as_json = described.as_json
        self._description = description
        self.shape = described.shape
        self._decoders: dict[bytes, Callable[[Buffer], Any]] = {}
        self._encode_short: Callable[[Buffer], bytes] = self._first_short
        self._encode_long: Callable[[Buffer], list[Buffer]] = self._first_long

    def __repr__(self) -> str:
        return f"Codec({self.type_name})"

    def encode(self, payload: Buffer) -> list[Buffer]:
        """The parts of a CDR message: little-endian XCDR1, its encapsulation first.

        Each long field of bytes or text is a separate part, a view of the payload. Raises CdrError if the
        payload is not a message of the type, or has a number that CDR can't hold.
        """
        try:
            return [self._encode_short(payload)] if len(payload) < LONG else self._encode_long(payload)
        except _WRONG as error:
            raise CdrError(f"no payload of {self.shape.name}: {error}") from None

    def encode_many(self, payloads: Iterable[Buffer]) -> list[bytes]:
        """CDR messages in one piece each, faster than one `encode` for each; for short messages.

        Raises CdrError, as `encode` does, if one of them is not a message of the type.
        """
        try:
            return list(map(self._encode_short, payloads))
        except _WRONG as error:
            raise CdrError(f"no payload of {self.shape.name}: {error}") from None

    def decode(self, data: Buffer) -> bytes:
        """The MessagePack payload of a CDR message, as `publish_encoded` takes it.

        Accepts both byte orders, XCDR1 and XCDR2, plain and delimited. Bytes behind the last field are
        ignored: ROS 2 pads there, and if its serialize_message reserves too many bytes, it leaves the rest.
        Raises CdrError if the message is malformed.
        """
        body: Buffer
        if len(data) < LONG:
            data = bytes(data)
            head, body = data[:2], data[4:]
        else:
            head, body = bytes(data[:2]), memoryview(data)[4:]
        try:
            decode = self._decoders.get(head) or self._decoder(head, len(data))
            return _pack(decode(body))
        except _WRONG as error:
            raise CdrError(f"no CDR message of {self.type_name}: {error}") from None

    def _first_short(self, payload: Buffer) -> bytes:
        encode: Callable[[Buffer], bytes] = encoder(self._description, self.shape, False)
        self._encode_short = encode
        return encode(payload)

    def _first_long(self, payload: Buffer) -> list[Buffer]:
        encode: Callable[[Buffer], list[Buffer]] = encoder(self._description, self.shape, True)
        self._encode_long = encode
        return encode(payload)

    def _decoder(self, head: bytes, size: int) -> Callable[[Buffer], Any]:
        representation = REPRESENTATIONS.get(head)
        if representation is None or size < 4:
            raise ValueError(f"it begins with {head.hex(' ')}" if size >= 4 else f"it has {size} bytes")
        made = self._decoders[head] = decoder(self._description, self.shape, representation)
        return made


_codecs: Final[dict[bytes, Codec]] = {}


def codec_of(schema: MessageSchema) -> Codec:
    """The codec of a type, made once.

    Raises ConfigurationError if the type can't be written as CDR (a `wstring`), and if the schema is
    malformed or too large.
    """
    if (known := _codecs.get(schema.encoded)) is None:
        if len(_codecs) >= _MOST_CODECS:
            del _codecs[next(iter(_codecs))]
        known = _codecs[schema.encoded] = Codec(schema)
    return known


def schema_of_definition(type_name: str, definition: str) -> MessageSchema:
    """The schema of a type in a bag file: from the text of the type and of all types that it needs.

    Raises ConfigurationError if the text is malformed, or names a missing type.
    """
    return MessageSchema.of(parse(type_name, definition))
