"""Messages as bytes, outside of topics; programs import it as `rclpy.serialization`.

The bytes are those that the bus sends: MessagePack, not CDR as with ROS 2.
"""

from typing import Any

import msgspec

from bus.types.support import type_support

__all__ = ["deserialize_message", "serialize_message"]


def serialize_message(message: Any) -> bytes:
    """The bytes of a message; raises MessageTypeError for one whose contents have become wrong."""
    return type_support(type(message)).encode_checked(message)


def deserialize_message(serialized_message: bytes, message_type: type) -> Any:
    """The message of that type that the bytes hold; raises ValueError for others."""
    support: Any = type_support(message_type)
    try:
        return support.decode(serialized_message)
    except msgspec.DecodeError as error:
        raise ValueError(f"these bytes are no {support.name}: {error}") from error
