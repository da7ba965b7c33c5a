"""Messages as bytes, outside of topics; programs import it as `rclpy.serialization`.

They are the bus's bytes: MessagePack, not CDR as in ROS 2.
"""

from typing import Any

import msgspec

from bus.types.support import type_support

__all__ = ["deserialize_message", "serialize_message"]


def serialize_message(message: Any) -> bytes:
    """The bytes of a message; raises MessageTypeError if its contents have become invalid."""
    return type_support(type(message)).encode_checked(message)


def deserialize_message(serialized_message: bytes, message_type: type) -> Any:
    """The message of that type in the bytes; raises ValueError if they are invalid."""
    support: Any = type_support(message_type)
    try:
        return support.decode(serialized_message)
    except msgspec.DecodeError as error:
        raise ValueError(f"these bytes are no {support.name}: {error}") from error
