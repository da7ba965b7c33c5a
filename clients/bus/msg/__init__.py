"""ROS 2's ready-made message classes, one module a package: `from bus.msg.std_msgs import String`.

Owns: the base class, the primitive types (to write your own messages with) and the list of packages. The
module of a package is imported only when it is asked for. Must not know: topics, schemas, the wire.

    from bus.msg import Message, float64, uint8

    class Wheel(Message, kw_only=True):
        index: uint8 = 0
        speed: float64 = 0.0
"""

from typing import Final

from bus.msg._types import (
    Message,
    byte,
    byte_array,
    char,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    string,
    uint8,
    uint8_array,
    uint16,
    uint32,
    uint64,
)

__all__ = [
    "PACKAGES",
    "Message",
    "byte",
    "byte_array",
    "char",
    "float32",
    "float64",
    "int8",
    "int16",
    "int32",
    "int64",
    "string",
    "uint8",
    "uint8_array",
    "uint16",
    "uint32",
    "uint64",
]

PACKAGES: Final = (
    "builtin_interfaces",
    "geometry_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "sensor_msgs",
    "std_msgs",
)
