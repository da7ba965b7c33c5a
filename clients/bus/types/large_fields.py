"""Messages with a long field of bytes or text: encoded around it, decoded without copying it.

An image is copied once into the ring, and not at all if its reader uses a view. Owns the search for such a
field in an encoding; knows neither topics nor routes.
"""

import os
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeVar, cast

import msgspec
from msgspec import inspect

from bus.errors import MessageTypeError
from bus.wire.runs import Buffer

M = TypeVar("M", bound=msgspec.Struct)

LONG_BYTES = 64 << 10
"""From this length on, it pays off not to copy a bytes field."""

LONG_TEXT = 256 << 10
"""From this length on, it pays off for ASCII text, too, which Python keeps as UTF-8."""

_BIN_32, _STR_32, _ARRAY_16 = 0xC6, 0xDB, 0xDC  # of MessagePack
_pack_head = struct.Struct(">BI").pack

# Replaces the field while the rest is encoded. It is random, so no message contains it.
_MARK = os.urandom(24)
_RAW_MARK = msgspec.Raw(_MARK)


def bytes_fields(cls: type[msgspec.Struct]) -> tuple[str, ...]:
    """Names of the bytes fields of `cls`."""
    names: tuple[str, ...] = _fields(cast(Any, cls), inspect.BytesType)
    return names


def text_fields(cls: type[msgspec.Struct]) -> tuple[str, ...]:
    """Names of the text fields of `cls`."""
    names: tuple[str, ...] = _fields(cast(Any, cls), inspect.StrType)
    return names


@cache
def is_bounded(cls: type[msgspec.Struct], name: str) -> bool:
    """Whether the bytes field `name` of `cls` has a bounded length."""
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    kinds = [_bare(field.type) for field in info.fields if field.name == name]
    return kinds != [inspect.BytesType()]


@cache
def _fields(cls: Any, kind: type[inspect.Type]) -> tuple[str, ...]:
    if not issubclass(cls, msgspec.Struct):
        return ()  # the class has its own way to encode
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    return tuple(field.name for field in info.fields if isinstance(_bare(field.type), kind))


def long_field(message: msgspec.Struct, names: tuple[str, ...]) -> tuple[str, memoryview | str] | None:
    """The first long field of the named ones, as bytes or as ASCII text; None if none is long.

    Any object with a contiguous buffer of bytes counts as bytes, for example an array of numpy.
    """
    for name in names:
        value = getattr(message, name, None)
        if value.__class__ is str:
            if len(value) >= LONG_TEXT and value.isascii():
                return name, value
            continue
        if value.__class__ is bytes:
            if len(value) >= LONG_BYTES:
                return name, memoryview(value)
            continue
        try:
            view = memoryview(cast(Any, value))
        except TypeError:
            continue
        is_bytes = view.format == "B" or value.__class__ is memoryview
        if view.nbytes >= LONG_BYTES and view.c_contiguous and is_bytes:
            return name, view.cast("B")
    return None


def with_field(message: M, name: str, value: Any) -> M:
    """A copy of `message` with `value` as field `name`, without the class's own checks: `message` has passed
    them."""
    changed: M = cast(Any, message).__copy__()
    msgspec.structs.force_setattr(changed, name, value)
    return changed


def encode_around(
    message: M, name: str, size: int, encode: Callable[[M], bytes], *, is_text: bool = False
) -> tuple[bytes, bytes]:
    """The encoding of `message` with `size` bytes as field `name`: the bytes before the field and after it.

    `message` is a copy made by `with_field`; its field is overwritten.
    """
    msgspec.structs.force_setattr(message, name, _RAW_MARK)
    before, _, after = encode(message).partition(_MARK)
    if len(before) % 8 == 1 and before[0] >> 4 == 9:
        # Use a longer head for the same array. Then the text of a String begins at a multiple of 8, and its
        # reader checks and copies it in one pass.
        before = bytes((_ARRAY_16, 0, before[0] & 15)) + before[1:]
    return before + _pack_head(_STR_32 if is_text else _BIN_32, size), after


def joined(parts: Sequence[Buffer | str]) -> Buffer:
    """The bytes of a sample given in parts."""
    if len(parts) == 1 and not isinstance(parts[0], str):
        return parts[0]
    return b"".join(part.encode() if isinstance(part, str) else part for part in parts)


def in_bytes(payload: Buffer) -> Buffer:
    """The same memory with its length in bytes, for items of any size."""
    view = memoryview(payload)
    return payload if view.nbytes == len(payload) else view.cast("B")


def no_such_field(cls: type[msgspec.Struct], name: str) -> MessageTypeError:
    """The error for a `name` that is no bytes field."""
    names = bytes_fields(cls)
    known = f"it has {', '.join(names)}" if names else "it has none"
    return MessageTypeError(f"{cls.__qualname__} has no field of bytes called {name!r}; {known}")


def view_type(cls: type[M]) -> type[M]:
    """A subclass of `cls` with read-only views into the decoded buffer as bytes fields, at any depth."""
    return cast(type[M], _view_type(cls))


@cache
def _view_type(cls: Any) -> Any:
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    changed: dict[str, Any] = {}
    defaults: dict[str, Any] = {}
    for field in info.fields:
        bare = _bare(field.type)
        if isinstance(bare, inspect.BytesType):
            changed[field.name] = memoryview
            defaults[field.name] = msgspec.field(default=b"", name=field.encode_name)
        elif isinstance(bare, inspect.StructType) and (inner := _view_type(bare.cls)) is not bare.cls:
            changed[field.name] = inner
            given = {} if field.required else {"default_factory": inner}
            defaults[field.name] = msgspec.field(name=field.encode_name, **given)
    if not changed:
        return cls
    namespace = {"__annotations__": changed, "__module__": cls.__module__, "__qualname__": cls.__qualname__}
    return type(cls)(cls.__name__, (cls,), namespace | defaults, kw_only=True)


def _bare(kind: inspect.Type) -> inspect.Type:
    """`kind` without annotations."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    return kind
