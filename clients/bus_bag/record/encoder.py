"""The encoding of messages in a bag: CDR, or for types that CDR can't have, a text of JSON.

A bag has only one serialization format. So the text is also CDR: of `busd/msg/Json`, which has one field.
"""

from collections.abc import Iterable
from functools import cache
from typing import Protocol

import msgspec

from bus.errors import ConfigurationError
from bus.schema import MessageSchema
from bus.types.schema import build
from bus.wire.runs import Buffer
from bus_ros.cdr import CdrError, Codec, codec_of, schema_of_definition

__all__ = ["Encoder", "encoder_of"]

_NAME, _DEFINITION = "busd/msg/Json", "string data\n"


class Encoder(Protocol):
    """Encodes messages of one type, and describes the type; `Codec` is one."""

    type_name: str
    type_hash: str
    definition: str
    as_json: tuple[str, ...]

    def encode(self, payload: Buffer) -> list[Buffer]: ...

    def encode_many(self, payloads: Iterable[Buffer]) -> list[bytes]: ...


def encoder_of(schema: MessageSchema) -> tuple[Encoder, str]:
    """The encoder of a type. If it makes texts of JSON, also the reason.

    Raises ConfigurationError for a schema that is malformed or too large.
    """
    try:
        return codec_of(schema), ""
    except ConfigurationError as error:
        build(schema.description)
        return _JsonEncoder(schema.type_name), str(error)


class _JsonEncoder:
    def __init__(self, type_name: str) -> None:
        self._codec = _codec()
        self.type_name, self.type_hash = self._codec.type_name, self._codec.type_hash
        self.definition = self._codec.definition
        self.as_json: tuple[str, ...] = (type_name,)

    def encode(self, payload: Buffer) -> list[Buffer]:
        """Raises CdrError if the payload is not MessagePack, or if JSON can't have its values."""
        try:
            text = msgspec.json.encode(msgspec.msgpack.decode(payload)).decode()
        except (ValueError, TypeError, RecursionError) as error:
            raise CdrError(f"a payload that JSON can't represent: {error}") from None
        return self._codec.encode(msgspec.msgpack.encode([text]))

    def encode_many(self, payloads: Iterable[Buffer]) -> list[bytes]:
        return [b"".join(self.encode(payload)) for payload in payloads]


@cache
def _codec() -> Codec:
    return codec_of(schema_of_definition(_NAME, _DEFINITION))
