"""Conversion of rosidl-style messages to the bytes of the native classes of the same name, and back.

Owns: the source text of two functions per class, compiled as dataclasses does it. The names in it come from
definitions. Their grammar allows only plain identifiers. Must not know: the checks of assigned values,
topics.

`encode` builds the message as nested tuples, for one call of the encoder. `decode` lets msgspec check and
decode the native class, and copies the fields into a new object without calling a constructor.
"""

from array import array
from collections.abc import Callable, Collection, Iterable, Sized
from keyword import iskeyword
from typing import Any, Final, TypeVar

import msgspec
from msgspec import Struct

from bus.types.idl import Field
from bus_ros.rosidl import numbers
from bus_ros.rosidl.message import RosMessage

__all__ = ["codec"]


S = TypeVar("S", bound=Sized)


def codec(
    cls: type[RosMessage], native: type[Struct]
) -> tuple[Callable[[RosMessage], bytes], Callable[[bytes | bytearray | memoryview], RosMessage]]:
    """The functions `encode` and `decode` of a class that `bus_ros.rosidl.classes` made.

    `encode` raises if a content has become wrong after its assignment; `decode` raises msgspec.DecodeError.
    """
    source = _Source()
    expression = source.encoded(cls, "m")
    source.add(0, "def encode(m):")
    source.add(1, f"return pack({expression})")
    source.add(0, "def decode(buffer):")
    source.add(1, "n = unpack(buffer)")
    source.made(cls, "m", "n")
    source.add(1, "return m")
    source.names["unpack"] = msgspec.msgpack.Decoder(native).decode
    exec(compile("\n".join(source.lines), f"<wire of {cls.__type_name__}>", "exec"), source.names)
    return source.names["encode"], source.names["decode"]


def _as_plain(value: object) -> object:
    """Convert instances of subclasses of the plain types, such as scalars of numpy."""
    for kind in (float, int, str):
        if isinstance(value, kind):
            return kind.__str__(value) if kind is str else kind(value)
    raise TypeError(f"'{type(value).__name__}' can't be encoded")


_pack: Final = msgspec.msgpack.Encoder(enc_hook=_as_plain).encode


class _Source:
    """Lines of generated functions, and the names that they use."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[str, Any] = {
            "pack": _pack,
            "new": object.__new__,
            "array": array,
            "items": _items,
            "several": _several,
            "joined": _joined,
            "parted": _parted,
            "at_most": _at_most,
            "exactly": _exactly,
        }
        self._makers: dict[type, str] = {}
        self._variables = 0

    def add(self, indent: int, line: str) -> None:
        self.lines.append(" " * indent + line)

    def encoded(self, cls: type[RosMessage], value: str) -> str:
        """An expression for the fields of the object that the expression `value` returns."""
        parts = [self._part(cls, field, f"{value}._{field.name}") for field in cls.__definition__.fields]
        return f"({', '.join(parts)}{',' * (len(parts) == 1)})"

    def _part(self, cls: type[RosMessage], field: Field, value: str) -> str:
        type_ = field.type
        nested = cls.__nested__.get(field.name)
        if not type_.array:
            return value if nested is None else self.encoded(nested, value)
        limit = "" if type_.array == "unbounded" else f", {type_.size}"
        if type_.base in numbers.CODES:
            if type_.array == "fixed":
                plain = self._variable()
                value = f"({plain} if len({plain} := {value}) == {type_.size} else exactly({plain}{limit}))"
                return f"bytes({value})" if type_.base == "uint8" else f"{value}.tolist()"
            value = f"at_most({value}{limit})" if limit else value
            return f"memoryview({value})" if type_.base == "uint8" else f"{value}.tolist()"
        is_fixed = type_.array == "fixed"
        if type_.base == "byte":
            return f"joined({value}{limit or ', None'}, {is_fixed})"
        if nested is not None:
            item = self._variable()
            values = f"items({value}, {self._name(nested)}{limit or ', None'}, {is_fixed})"
            return f"[{self.encoded(nested, item)} for {item} in {values}]"
        kind = self._name(bool if type_.base == "bool" else str)
        return f"several({value}, {kind}{limit or ', None'}, {is_fixed})"

    def made(self, cls: type[RosMessage], name: str, native: str) -> None:
        """Write the lines that make the object `name` from the native object."""
        self.add(1, f"{name} = new({self._name(cls)})")
        for field in cls.__definition__.fields:
            value, nested = f"{native}.{field.name}", cls.__nested__.get(field.name)
            if iskeyword(field.name):
                value = f"getattr({native}, {field.name!r})"
            if nested is not None and not field.type.array:
                inner, source = self._variable(), self._variable()
                self.add(1, f"{source} = {value}")
                self.made(nested, inner, source)
                value = inner
            elif nested is not None:
                item = self._variable()
                value = f"[{self._maker(nested)}({item}) for {item} in {value}]"
            elif field.type.array:
                value = self._values(field, value)
            self.add(1, f"{name}._{field.name} = {value}")

    def _values(self, field: Field, value: str) -> str:
        base = field.type.base
        if base == "byte":
            return f"parted({value})"
        if base not in numbers.CODES:
            return value
        code = numbers.CODES[base]
        if field.type.array == "fixed" and base == "uint8":
            return f"{self._name(numbers.octets())}(bytearray({value}))"
        if field.type.array == "fixed":
            return f"{self._name(numbers.fixed(code))}({value})"
        return f"array({code!r}, {value})"

    def _maker(self, cls: type) -> str:
        """The name of a function that makes an object from a native one."""
        if cls not in self._makers:
            outer, self.lines = self.lines, []
            name = self._makers[cls] = self._variable()
            self.add(0, f"def {name}(n):")
            self.made(cls, "m", "n")
            self.add(1, "return m")
            # It goes in front of the current function, and behind the functions that it uses.
            self.lines += outer
        return self._makers[cls]

    def _variable(self) -> str:
        self._variables += 1
        return f"v{self._variables}"

    def _name(self, value: object) -> str:
        self._variables += 1
        self.names[f"c{self._variables}"] = value
        return f"c{self._variables}"


def _exactly(values: S, size: int) -> S:
    if len(values) != size:
        raise ValueError(f"{len(values)} values, not {size}")
    return values


def _at_most(values: S, size: int) -> S:
    if len(values) > size:
        raise ValueError(f"{len(values)} values, more than {size}")
    return values


def _bounded(values: S, size: int | None, is_fixed: bool) -> S:
    if size is None:
        return values
    return _exactly(values, size) if is_fixed else _at_most(values, size)


def _items(values: Collection[object], cls: type, size: int | None, is_fixed: bool) -> Collection[object]:
    """Messages of one class, or of its subclasses."""
    if values and set(map(type, values)) != {cls}:
        for value in values:
            if not isinstance(value, cls):
                raise TypeError(f"'{type(value).__name__}' is no {cls.__name__}")
    return _bounded(values, size, is_fixed)


def _several(values: Iterable[object], kind: type, size: int | None, is_fixed: bool) -> list[object]:
    """Texts or booleans."""
    values = values if type(values) is list else list(values)
    if values and set(map(type, values)) != {kind}:
        for value in values:
            if not isinstance(value, kind):
                raise TypeError(f"'{type(value).__name__}' is no {kind.__name__}")
    return _bounded(values, size, is_fixed)


def _joined(values: Collection[bytes], size: int | None, is_fixed: bool) -> bytes:
    if any(len(value) != 1 for value in values):
        raise ValueError("an octet is one byte")
    return b"".join(_bounded(values, size, is_fixed))


def _parted(data: bytes) -> list[bytes]:
    return [data[index : index + 1] for index in range(len(data))]
