"""Programs for the native core: the operations that convert a type's payloads to CDR."""

import os
import zlib
from struct import Struct
from typing import TYPE_CHECKING, Final

from bus_ros.cdr.shapes import Bytes, Message, Primitive, Sequence, Shape, Wrapped

if TYPE_CHECKING:
    from bus_bag.core._core import Program, crc32
elif os.environ.get("BUS_NATIVE") == "no":
    Program, crc32 = None, zlib.crc32
else:
    try:
        from bus_bag.core import _core
    except ImportError:
        Program, crc32 = None, zlib.crc32
    else:
        Program, crc32 = _core.Program, getattr(_core, "crc32", zlib.crc32)

__all__ = ["Program", "crc32", "operations", "program_of"]

_NUMBERS: Final = {
    kind: bytes([code])
    for code, kinds in enumerate(
        (
            ("bool",),
            ("byte",),
            ("uint8", "char"),
            ("int8",),
            ("uint16",),
            ("int16",),
            ("uint32",),
            ("int32",),
            ("uint64",),
            ("int64",),
            ("float32",),
            ("float64",),
        )
    )
    for kind in kinds
}
_TEXT, _EMPTY = b"\x10", b"\x14"
_BYTES, _LIST, _MESSAGE = 0x11, 0x12, 0x13
_bytes: Final = Struct("<BBII").pack
_list: Final = Struct("<BBIII").pack
_message: Final = Struct("<BH").pack
_ANY: Final = 0xFFFFFFFF
_MOST_FIELDS: Final = 0xFFFF
_MOST_BYTES: Final = 64 << 10
"""Size of the largest program: a type that contains another one many times repeats its operations."""


class _Unable(Exception):
    """A program can't express the type."""


def program_of(shape: Message) -> "Program | None":
    """The program of a type; None without the native core, and for a type that it can't express.

    A program can express all types of .msg files. It can't express maps, optional values and JSON.
    """
    found = None if Program is None else operations(shape)
    if found is None:
        return None
    try:
        return Program(found)
    except ValueError:  # too many nested types
        return None


def operations(shape: Message) -> bytes | None:
    """The operations for a type, as `program.h` describes them; None if there are none for it."""
    try:
        return _operation(shape, {})
    except (_Unable, RecursionError):
        return None


def _operation(shape: Shape, known: dict[Message, bytes]) -> bytes:
    match shape:
        case Primitive("string"):
            found = _TEXT
        case Primitive(kind):
            found = _NUMBERS[kind]
        case Bytes(size, most):
            found = _bytes(_BYTES, *_bounds(size, most))
        case Sequence(item, size, most):
            inner = _operation(item, known)
            found = _list(_LIST, *_bounds(size, most), len(inner)) + inner
        case Wrapped(item):
            found = _operation(item, known)
        case Message() if shape in known:
            found = known[shape]
        case Message(is_array=True, tag=None) if len(shape.shapes) <= _MOST_FIELDS:
            fields = b"".join([_operation(part, known) for part in shape.shapes])
            found = known[shape] = _message(_MESSAGE, len(shape.shapes)) + fields if shape.shapes else _EMPTY
        case _:
            raise _Unable
    if len(found) > _MOST_BYTES:
        raise _Unable
    return found


def _bounds(size: int | None, most: int | None) -> tuple[int, int, int]:
    """Whether it is an array, and the least and the most items."""
    if size is not None:
        return 1, size, size
    return 0, 0, _ANY if most is None else most
