"""ROS 2's ready-made message classes, one module a package: `from bus.msg.std_msgs import String`.

Owns: the base class, the primitive types (for your own messages) and the list of packages. The module of a
package is imported at its first use. Must not know: topics, schemas, the wire.

    from bus.msg import Message, float64, uint8

    class Wheel(Message, kw_only=True):
        index: uint8 = 0
        speed: float64 = 0.0
"""

from sys import _getframe
from typing import Any, Final

from bus.base.loading import loading

with loading():
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


def __getattr__(name: str) -> Any:
    if name in PACKAGES:
        from importlib import import_module

        return import_module(f"bus.msg.{name}")
    # Names that tools search, and modules that `from ... import` is about to import, are no mistakes.
    if name.startswith("_") or _getframe(1).f_code.co_name == "_handle_fromlist":
        raise AttributeError(f"module 'bus.msg' has no attribute {name!r}")
    from bus.base.missing_names import missing_name

    raise missing_name("bus.msg", name, (*PACKAGES, *__all__))
