"""Fast checks that the fields of a message have the right types, made for one class at a time.

Owns: the source text of one function for each class, compiled as dataclasses does it. Also the plan by which
the native core checks and encodes a message of plain values in one pass. Both are made only from the
program's classes, never from another process's schema. Must not know: errors, schemas, topics.

If a check returns True, the types are right. False only means that the exact check must decide: the value is
a scalar of numpy, a tuple instead of a list, or of a type for which no code is made. Text with lone
surrogates passes here and fails in the encoder.

Lists of numbers are checked by their encoding, which takes 3 ns per element instead of 17. A double is 0xcb
and 8 bytes, so a list of n doubles has 0xcb at every ninth place. An encoding with 0xcb at the first n of
these places can't be anything else. In the same way, a small integer is its own single byte.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Flag
from keyword import iskeyword
from types import MemberDescriptorType
from typing import Annotated, Any, Final

import msgspec
from msgspec import Meta, inspect

from bus import shm

__all__ = ["plan", "predicate"]

_MAX_LINES: Final = 2000
_MAX_INDENT: Final = 16
_LONG: Final = 16
_INT64_MIN: Final = -(2**63)
_UINT64_MAX: Final = 2**64 - 1
_DOUBLE: Final = b"\xcb"
_SMALL_UNSIGNED: Final = bytes(range(0x80))
_SMALL_SIGNED: Final = _SMALL_UNSIGNED + bytes(range(0xE0, 0x100))
_NUMBERS: Final = frozenset((float, int))

_encode: Final = msgspec.msgpack.Encoder().encode


def predicate(cls: type[msgspec.Struct]) -> Callable[[Any], bool]:
    """Make a function that returns True if an instance of `cls` surely has fields of the right types."""
    source = _Source()
    try:
        source.fields(inspect.type_info(cls), "m")
    except _NoCode:
        return _unsure
    text = "\n".join(
        ["def is_valid(m):", " try:", *source.lines, "  return True", " except Exception:", "  return False"]
    )
    exec(compile(text, f"<check of {cls.__qualname__}>", "exec"), source.names)
    check: Callable[[Any], bool] = source.names["is_valid"]
    return check


def plan(cls: type[msgspec.Struct], kinds: Mapping[type, type] | None = None) -> Any:
    """Make a `_core.Plan` for messages of `cls`; None for unsupported classes, and without the native core.

    If the plan encodes a message, the message is right, and the bytes equal msgspec's encoding. Other
    messages may be right, too. `kinds`: the messages do not belong to `cls` and its nested classes, but to
    the classes that stand for them, which keep the field `x` in the slot `_x`.
    """
    return _Planner(kinds).plan(inspect.type_info(cls)) if shm.has_core() else None


class _Planner:
    def __init__(self, kinds: Mapping[type, type] | None) -> None:
        self._kinds = kinds
        self._known: dict[type, Any] = {}

    def plan(self, info: inspect.Type) -> Any:
        assert isinstance(info, inspect.StructType)
        cls, fields, known = info.cls, [], self._known
        if cls in known:
            return known[cls]
        known[cls] = None  # in case the class contains itself
        if info.tag is not None or cls.__struct_config__.omit_defaults or getattr(cls, "__foreign__", False):
            return None
        kind, prefix = (cls, "") if self._kinds is None else (self._kinds[cls], "_")
        for field in info.fields:
            slot = getattr(kind, prefix + field.name, None)
            value = self._value(field.type)
            if value is None or not isinstance(slot, MemberDescriptorType):
                return None
            fields.append((slot, b"" if info.array_like else _encode(field.encode_name), value))
        known[cls] = made = shm.native.Plan(kind, tuple(fields), info.array_like)
        return made

    def _value(self, info: inspect.Type) -> tuple[int, int, int, Any] | None:
        """The encoding of a value, its lowest and highest value or length, and the plan of its parts."""
        while isinstance(info, inspect.Metadata):
            info = info.type
        match info:
            case inspect.StrType(None, None, None):
                return shm.native.AS_TEXT, 0, 0, None
            case inspect.FloatType(None, None, None, None, None):
                return shm.native.AS_FLOAT, 0, 0, None
            case inspect.BoolType():
                return shm.native.AS_BOOL, 0, 0, None
            case inspect.IntType(multiple_of=None):
                least, most = _bounds(info)
                if least <= 2**63 - 1 and most >= 0:
                    return shm.native.AS_INT, max(least, _INT64_MIN), min(most, _UINT64_MAX), None
            case inspect.StructType() if isinstance(info.cls, type):
                inner = self.plan(info)
                return None if inner is None else (shm.native.AS_STRUCT, 0, 0, inner)
            # Classes that stand for others have other objects for the following types.
            case inspect.BytesType() if self._kinds is None:
                return shm.native.AS_BYTES, *_lengths(info), None
            case inspect.ListType() if self._kinds is None:
                item = self._value(info.item_type)
                return None if item is None else (shm.native.AS_LIST, *_lengths(info), item)
        return None


def _unsure(_: object) -> bool:
    return False


def _header_bytes(length: int) -> int:
    """Size of the header of a MessagePack array."""
    return 1 if length < 16 else 3 if length < 2**16 else 5


def _is_whole(value: object) -> bool:
    return type(value) is int and _INT64_MIN <= value <= _UINT64_MAX


def _is_buffer(value: object) -> bool:
    return type(value) is bytearray or (type(value) is memoryview and value.c_contiguous)


def _are_numbers(values: Any) -> bool:
    # Only for values that were encoded, so no integer has more than 64 bits.
    return _NUMBERS.issuperset(map(type, values))


def _integers(least: int, most: int) -> Callable[[Any], bool]:
    decode = msgspec.msgpack.Decoder(list[_int_type(least, most)]).decode  # type: ignore[misc]
    small = _SMALL_SIGNED if least <= -32 else _SMALL_UNSIGNED if least <= 0 else b""
    small = small if most >= 127 else b""

    def are_integers(values: Any) -> bool:
        data = _encode(values)
        if len(values) < _LONG or data[_header_bytes(len(values)) :].translate(None, small):
            decode(data)
        return True

    return are_integers


def _int_type(least: int, most: int) -> Any:
    if most > 2**63 - 1:
        return Annotated[int, Meta(ge=least)]
    return Annotated[int, Meta(ge=least, le=most)]


class _NoCode(Exception):
    """No check can be made for this type: every message takes the long way."""


class _Source:
    """Generates the lines of a check, which return False for a wrong value, and the names that they use."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, Any] = {
            "_encode": _encode,
            "_is_whole": _is_whole,
            "_are_numbers": _are_numbers,
            "_double": _DOUBLE,
            "_is_buffer": _is_buffer,
        }
        self._indent = 2
        self._variables = 0
        self._open: list[object] = []

    def fields(self, info: inspect.Type, value: str) -> None:
        assert isinstance(info, inspect.StructType)
        # Names from another process must not get into the code.
        if info.cls in self._open or getattr(info.cls, "__foreign__", False):
            raise _NoCode
        self._open.append(info.cls)
        for field in info.fields:
            if not field.name.isidentifier() or iskeyword(field.name):
                raise _NoCode
            self._check(field.type, f"{value}.{field.name}")
        self._open.pop()

    def _check(self, info: inspect.Type, value: str) -> None:
        while isinstance(info, inspect.Metadata):
            info = info.type
        match info:
            case inspect.BoolType():
                self._refuse(f"type({value}) is not bool")
            case inspect.StrType(None, None, None):
                self._refuse(f"type({value}) is not str")
            case inspect.FloatType(None, None, None, None, None):
                self._refuse(f"type({value}) is not float and not _is_whole({value})")
            case inspect.IntType(multiple_of=None):
                least, most = _bounds(info)
                name = self._variable()
                self._refuse(f"type({name} := {value}) is not int or not {least} <= {name} <= {most}")
            case inspect.NoneType():
                self._refuse(f"{value} is not None")
            case inspect.BytesType() | inspect.ByteArrayType() | inspect.MemoryViewType():
                self._check_bytes(info, value)
            case inspect.StructType() if isinstance(info.cls, type):
                name = self._assign(value)
                self._refuse(f"type({name}) is not {self._name(info.cls)}")
                self.fields(info, name)
            case inspect.EnumType() if not issubclass(info.cls, Flag):
                self._refuse(f"type({value}) is not {self._name(info.cls)}")
            case inspect.UnionType() if info.includes_none and len(info.types) == 2:
                self._check_optional(info, value)
            case inspect.ListType() | inspect.VarTupleType() | inspect.SetType() | inspect.FrozenSetType():
                self._check_collection(info, value)
            case inspect.TupleType():
                name = self._assign(value)
                self._refuse(f"type({name}) is not tuple or len({name}) != {len(info.item_types)}")
                for index, item in enumerate(info.item_types):
                    self._check(item, f"{name}[{index}]")
            case inspect.DictType(min_length=None, max_length=None):
                self._check_dict(info, value)
            case _:
                raise _NoCode

    def _check_bytes(
        self, info: inspect.BytesType | inspect.ByteArrayType | inspect.MemoryViewType, value: str
    ) -> None:
        name = self._variable()
        if info.min_length is None and info.max_length is None:
            self._refuse(f"type({name} := {value}) is not bytes and not _is_buffer({name})")
        else:
            self._refuse(f"type({name} := {value}) is not bytes{_or_wrong_length(info, name)}")

    def _check_optional(self, info: inspect.UnionType, value: str) -> None:
        name = self._assign(value)
        self._block(f"if {name} is not None:")
        self._check(next(item for item in info.types if not isinstance(item, inspect.NoneType)), name)
        self._indent -= 1

    def _check_collection(self, info: inspect.CollectionType, value: str) -> None:
        name = self._assign(value)
        kind = {
            inspect.ListType: "list",
            inspect.VarTupleType: "tuple",
            inspect.SetType: "set",
            inspect.FrozenSetType: "frozenset",
        }[type(info)]
        self._refuse(f"type({name}) is not {kind}{_or_wrong_length(info, name)}")
        item = info.item_type
        while isinstance(item, inspect.Metadata):
            item = item.type
        match item:
            case inspect.FloatType(None, None, None, None, None):
                self._check_floats(info, name)
            case inspect.IntType(multiple_of=None):
                self._refuse(f"not {self._name(_integers(*_bounds(item)))}({name})")
            case _:
                element = self._variable()
                self._block(f"for {element} in {name}:")
                self._check(item, element)
                self._indent -= 1

    def _check_floats(self, info: inspect.CollectionType, name: str) -> None:
        if info.min_length is not None and info.min_length == info.max_length:
            header, doubles = str(_header_bytes(info.min_length)), self._name(_DOUBLE * info.min_length)
        else:
            length = self._assign(f"len({name})")
            header, doubles = f"1 if {length} < 16 else 3 if {length} < 65536 else 5", f"_double * {length}"
        self._refuse(f"_encode({name})[{header}::9] != {doubles} and not _are_numbers({name})")

    def _check_dict(self, info: inspect.DictType, value: str) -> None:
        name, key, item = self._assign(value), self._variable(), self._variable()
        self._refuse(f"type({name}) is not dict")
        self._block(f"for {key}, {item} in {name}.items():")
        self._check(info.key_type, key)
        self._check(info.value_type, item)
        self._indent -= 1

    def _add(self, line: str) -> None:
        if len(self.lines) >= _MAX_LINES or self._indent > _MAX_INDENT:
            raise _NoCode
        self.lines.append(" " * self._indent + line)

    def _refuse(self, condition: str) -> None:
        self._add(f"if {condition}: return False")

    def _block(self, line: str) -> None:
        self._add(line)
        self._indent += 1

    def _variable(self) -> str:
        self._variables += 1
        return f"v{self._variables}"

    def _assign(self, value: str) -> str:
        name = self._variable()
        self._add(f"{name} = {value}")
        return name

    def _name(self, value: object) -> str:
        self._variables += 1
        self.names[f"c{self._variables}"] = value
        return f"c{self._variables}"


def _bounds(info: inspect.IntType) -> tuple[int, int]:
    least, most = _INT64_MIN, _UINT64_MAX
    if info.ge is not None:
        least = info.ge
    if info.gt is not None:
        least = info.gt + 1
    if info.le is not None:
        most = info.le
    if info.lt is not None:
        most = info.lt - 1
    return least, most


def _lengths(info: Any) -> tuple[int, int]:
    return info.min_length or 0, _UINT64_MAX if info.max_length is None else info.max_length


def _or_wrong_length(info: Any, name: str) -> str:
    least, most = info.min_length, info.max_length
    if least is None and most is None:
        return ""
    if least == most:
        return f" or len({name}) != {least}"
    return f" or not {least or 0} <= len({name}) <= {most if most is not None else 2**63}"
