"""Message types in files of bags: busd's own description of a topic's type, as a text. Pure.

A definition in the language of .msg files can't describe every type of busd (maps, unions, texts as keys). So
a channel also has the schema that discovery uses. With it, messages keep their type.
"""

from base64 import b64decode, b64encode
from binascii import Error as Base64Error

from bus.errors import ConfigurationError
from bus.schema import MessageSchema

__all__ = ["SCHEMA", "TYPE_HASH", "schema_from_text", "schema_to_text"]

SCHEMA = "busd.schema"
"""The key of the description in a topic's further metadata (`extra`)."""
TYPE_HASH = "busd.type_hash"
"""The key of the type's hash on the bus."""


def schema_to_text(schema: MessageSchema) -> str:
    """The value of `busd.schema`: the encoded description (MessagePack) in base64."""
    return b64encode(schema.encoded).decode()


def schema_from_text(text: str) -> MessageSchema:
    """Read the value of `busd.schema`. Raises ConfigurationError if it is not a description."""
    try:
        encoded = b64decode(text, validate=True)
    except (Base64Error, ValueError):
        raise ConfigurationError(f"{SCHEMA} is not base64") from None
    return MessageSchema.of(MessageSchema("", "", encoded).description)
