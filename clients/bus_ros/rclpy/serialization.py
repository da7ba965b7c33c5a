"""Messages as bytes, outside of topics; programs import it as `rclpy.serialization`.

They are the bus's bytes: MessagePack, not CDR as in ROS 2. CDR from bags and other programs is accepted, too.
"""

from typing import Any, Final

import msgspec

from bus.schema import schema_of
from bus.types.support import type_support

__all__ = ["deserialize_message", "native_bytes", "serialize_message"]

_CDR: Final = 0
"""The first byte of each message in CDR; no message in MessagePack begins with it."""


def serialize_message(message: Any) -> bytes:
    """The bytes of a message; raises MessageTypeError if its contents have become invalid."""
    return type_support(type(message)).encode_checked(message)


def deserialize_message(serialized_message: bytes, message_type: type) -> Any:
    """The message of that type in the bytes, MessagePack or CDR; raises ValueError if they are invalid."""
    support: Any = type_support(message_type)
    try:
        return support.decode(native_bytes(serialized_message, message_type))
    except msgspec.DecodeError as error:
        raise ValueError(f"these bytes are no {support.name}: {error}") from error


def native_bytes(serialized_message: bytes, message_type: type) -> bytes:
    """The message as MessagePack; raises ValueError (CdrError) for CDR that is no message of the type."""
    if serialized_message[:1] != bytes((_CDR,)):
        return serialized_message
    from bus_ros.cdr import codec_of  # late: few programs have CDR

    return codec_of(schema_of(type_support(message_type))).decode(serialized_message)
