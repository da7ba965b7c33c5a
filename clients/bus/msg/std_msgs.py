"""std_msgs of ROS 2 Jazzy: single values, arrays and the header.

Made by `make messages`.
"""

from msgspec import field

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
from bus.msg.builtin_interfaces import Time

__all__ = [
    "Bool",
    "Byte",
    "ByteMultiArray",
    "Char",
    "ColorRGBA",
    "Empty",
    "Float32",
    "Float32MultiArray",
    "Float64",
    "Float64MultiArray",
    "Header",
    "Int8",
    "Int8MultiArray",
    "Int16",
    "Int16MultiArray",
    "Int32",
    "Int32MultiArray",
    "Int64",
    "Int64MultiArray",
    "MultiArrayDimension",
    "MultiArrayLayout",
    "String",
    "UInt8",
    "UInt8MultiArray",
    "UInt16",
    "UInt16MultiArray",
    "UInt32",
    "UInt32MultiArray",
    "UInt64",
    "UInt64MultiArray",
]


class Bool(Message, kw_only=True):
    """A truth value."""

    data: bool = False


class Byte(Message, kw_only=True):
    """One octet, as `bytes` of length 1."""

    data: byte = b"\x00"


class MultiArrayDimension(Message, kw_only=True):
    """One dimension of a multi-array: its label, size and stride in elements."""

    label: string = ""
    size: uint32 = 0
    stride: uint32 = 0


class MultiArrayLayout(Message, kw_only=True):
    """The dimensions of a multi-array, outermost first, and the padding before its data."""

    dim: list[MultiArrayDimension] = field(default_factory=list)
    data_offset: uint32 = 0


class ByteMultiArray(Message, kw_only=True):
    """An array of octets, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: byte_array = b""


class Char(Message, kw_only=True):
    """One character code, 0 to 255."""

    data: char = 0


class ColorRGBA(Message, kw_only=True):
    """A colour; every part from 0 to 1."""

    r: float32 = 0.0
    g: float32 = 0.0
    b: float32 = 0.0
    a: float32 = 0.0


class Empty(Message, kw_only=True):
    """Nothing: the message is the event."""


class Float32(Message, kw_only=True):
    """A number of single precision."""

    data: float32 = 0.0


class Float32MultiArray(Message, kw_only=True):
    """An array of numbers of single precision, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[float32] = field(default_factory=list)


class Float64(Message, kw_only=True):
    """A number of double precision."""

    data: float64 = 0.0


class Float64MultiArray(Message, kw_only=True):
    """An array of numbers of double precision, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[float64] = field(default_factory=list)


class Header(Message, kw_only=True):
    """When and in which coordinate frame the rest of a message was measured."""

    stamp: Time = field(default_factory=Time)
    frame_id: string = ""


class Int8(Message, kw_only=True):
    """An integer of 8 bits."""

    data: int8 = 0


class Int8MultiArray(Message, kw_only=True):
    """An array of integers of 8 bits, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[int8] = field(default_factory=list)


class Int16(Message, kw_only=True):
    """An integer of 16 bits."""

    data: int16 = 0


class Int16MultiArray(Message, kw_only=True):
    """An array of integers of 16 bits, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[int16] = field(default_factory=list)


class Int32(Message, kw_only=True):
    """An integer of 32 bits."""

    data: int32 = 0


class Int32MultiArray(Message, kw_only=True):
    """An array of integers of 32 bits, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[int32] = field(default_factory=list)


class Int64(Message, kw_only=True):
    """An integer of 64 bits."""

    data: int64 = 0


class Int64MultiArray(Message, kw_only=True):
    """An array of integers of 64 bits, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[int64] = field(default_factory=list)


class String(Message, kw_only=True):
    """A text."""

    data: string = ""


class UInt8(Message, kw_only=True):
    """An integer of 8 bits, not negative."""

    data: uint8 = 0


class UInt8MultiArray(Message, kw_only=True):
    """An array of integers of 8 bits, not negative, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: uint8_array = b""


class UInt16(Message, kw_only=True):
    """An integer of 16 bits, not negative."""

    data: uint16 = 0


class UInt16MultiArray(Message, kw_only=True):
    """An array of integers of 16 bits, not negative, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[uint16] = field(default_factory=list)


class UInt32(Message, kw_only=True):
    """An integer of 32 bits, not negative."""

    data: uint32 = 0


class UInt32MultiArray(Message, kw_only=True):
    """An array of integers of 32 bits, not negative, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[uint32] = field(default_factory=list)


class UInt64(Message, kw_only=True):
    """An integer of 64 bits, not negative."""

    data: uint64 = 0


class UInt64MultiArray(Message, kw_only=True):
    """An array of integers of 64 bits, not negative, of any number of dimensions."""

    layout: MultiArrayLayout = field(default_factory=MultiArrayLayout)
    data: list[uint64] = field(default_factory=list)
