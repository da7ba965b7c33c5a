"""Messages by the names of their types, for code that must not depend on their classes."""

from functools import cache
from typing import Any

from bus_ros.rosidl import message_class

__all__ = ["message", "message_type"]


@cache
def message_type(name: str) -> Any:
    """The class of `geometry_msgs/msg/Pose`."""
    return message_class(name)


def message(name: str, /, **fields: Any) -> Any:
    """A new message of that type."""
    return message_type(name)(**fields)
