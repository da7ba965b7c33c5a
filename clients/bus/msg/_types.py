"""The base of every ready-made message class, and ROS 2's primitive types as annotations.

Owns: the encoding of a message (an array of its fields, no names), its printed form and its name; the range
of a primitive. Must not know: schemas, hashes, the wire.

A primitive is the Python type plus `Meta(extra={"ros": <its ROS name>})`. Integers carry their range;
`uint64` has no upper bound because msgspec can't express it, and MessagePack can't exceed it. A `float32` is
only checked as a number: it is sent as a double. `uint8[]` is `bytes`, so an image is checked and copied in
one piece.
"""

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, ClassVar, Final, get_type_hints

from msgspec import Meta, Struct

int8 = Annotated[int, Meta(ge=-(2**7), le=2**7 - 1, extra={"ros": "int8"})]
int16 = Annotated[int, Meta(ge=-(2**15), le=2**15 - 1, extra={"ros": "int16"})]
int32 = Annotated[int, Meta(ge=-(2**31), le=2**31 - 1, extra={"ros": "int32"})]
int64 = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1, extra={"ros": "int64"})]
uint8 = Annotated[int, Meta(ge=0, le=2**8 - 1, extra={"ros": "uint8"})]
uint16 = Annotated[int, Meta(ge=0, le=2**16 - 1, extra={"ros": "uint16"})]
uint32 = Annotated[int, Meta(ge=0, le=2**32 - 1, extra={"ros": "uint32"})]
uint64 = Annotated[int, Meta(ge=0, extra={"ros": "uint64"})]
float32 = Annotated[float, Meta(extra={"ros": "float32"})]
float64 = Annotated[float, Meta(extra={"ros": "float64"})]
string = Annotated[str, Meta(extra={"ros": "string"})]
char = Annotated[int, Meta(ge=0, le=2**8 - 1, extra={"ros": "char"})]
byte = Annotated[bytes, Meta(min_length=1, max_length=1, extra={"ros": "byte"})]
"""One octet; `bytes` of length 1, as in rclpy."""

uint8_array = Annotated[bytes, Meta(extra={"ros": "uint8[]"})]
byte_array = Annotated[bytes, Meta(extra={"ros": "byte[]"})]

float64_9 = Annotated[list[float64], Meta(min_length=9, max_length=9)]
float64_12 = Annotated[list[float64], Meta(min_length=12, max_length=12)]
float64_36 = Annotated[list[float64], Meta(min_length=36, max_length=36)]

PRIMITIVES: Final[dict[str, Any]] = {
    "bool": bool,
    "int8": int8,
    "int16": int16,
    "int32": int32,
    "int64": int64,
    "uint8": uint8,
    "uint16": uint16,
    "uint32": uint32,
    "uint64": uint64,
    "float32": float32,
    "float64": float64,
    "string": string,
    "char": char,
    "byte": byte,
    "uint8[]": uint8_array,
    "byte[]": byte_array,
}
"""ROS name to annotation."""


def zeros(count: int) -> Callable[[], list[float]]:
    """A default factory for a fixed array of floats."""
    return partial(list, (0.0,) * count)


class Message(Struct, array_like=True):
    """Base of the ROS message classes, also for a user's own messages.

    `__type_name__` is `<package>/msg/<Class>` for the classes in bus.msg, `local/msg/<Class>` elsewhere, or
    the name that the class itself sets.
    """

    __type_name__: ClassVar[str]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__type_name__" not in cls.__dict__:
            package = cls.__module__.split(".")[2] if cls.__module__.startswith("bus.msg.") else "local"
            cls.__type_name__ = f"{package}/msg/{cls.__name__}"

    def __repr__(self) -> str:
        """The text of rclpy, except that a fixed array is a plain list (in rclpy it is numpy's)."""
        fields = ", ".join(f"{name}={_field_text(self, name)}" for name in self.__struct_fields__)
        return f"{self.__type_name__.replace('/', '.')}({fields})"


def _field_text(message: Message, name: str) -> str:
    value = getattr(message, name)
    if isinstance(value, bytes | bytearray | memoryview):
        declared = get_type_hints(type(message), include_extras=True)[name]
        if declared == byte_array:
            value = [bytes((octet,)) for octet in bytes(value)]
        elif declared != byte:
            value = list(bytes(value))
    return repr(value)
