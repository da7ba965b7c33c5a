"""From CDR to MessagePack payloads: a function for each type and encapsulation, generated and compiled.

Owns: both byte orders, XCDR1, XCDR2 plain and delimited. Must not know: definitions, the other direction.

The bytes come from other processes, so the functions do not trust them: they compare a count with the number
of remaining bytes before they make any element. In generated source, `p` is the position, and `end` is the
end of the message (or of a delimited part of it).
"""

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import msgspec
from msgspec import UNSET

from bus.wire.runs import Buffer
from bus_ros.cdr.annotations import json_annotation
from bus_ros.cdr.layout import CODES, Arrays, lay_out
from bus_ros.cdr.shapes import (
    SIZES,
    Bytes,
    Dict,
    Json,
    Message,
    Optional,
    Primitive,
    Sequence,
    Shape,
    Wrapped,
    least,
)
from bus_ros.cdr.source import Source

__all__ = ["REPRESENTATIONS", "Representation", "decoder"]

_MOST_IN_RUN: Final = 64
"""Longest array of fixed size that one unpack call reads together with its neighbours."""


class Representation(NamedTuple):
    """The encoding of a CDR message, from its first two bytes."""

    order: str
    """The byte order, in the notation of the module struct."""
    is_second: bool = False
    """XCDR2: alignment is 4 bytes at most, and a value without a fixed size begins with its length."""
    is_delimited: bool = False
    """Each message begins with its length, too."""


REPRESENTATIONS: Final = {
    b"\x00\x00": Representation(">"),
    b"\x00\x01": Representation("<"),
    b"\x00\x06": Representation(">", True),
    b"\x00\x07": Representation("<", True),
    b"\x00\x08": Representation(">", True, True),
    b"\x00\x09": Representation("<", True, True),
}


def decoder(
    description: Mapping[str, Any], shape: Message, representation: Representation
) -> Callable[[Buffer], Any]:
    """A function that converts a message to the objects that stand for it in MessagePack.

    It takes the bytes behind the encapsulation. It raises ValueError, struct.error, OverflowError or
    TypeError if they are not a message of the type.
    """
    writer = _Writer(description, representation)
    writer.root(shape)
    decode: Callable[[Buffer], Any] = writer.source.compile(shape.name)["decode"]
    return decode


class _Writer:
    def __init__(self, description: Mapping[str, Any], representation: Representation) -> None:
        self.source = Source(text=_text, short=_short, many=_many, UNSET=UNSET, without=_without)
        self._description = description
        self._order, self._is_second, self._is_delimited = representation
        self._alignment = 4 if self._is_second else 8
        self._offset: int | None = 0
        """The offset of the next read, modulo 8; None: it is known only at run time, from `p`."""
        self._codes: list[tuple[str, int]] = []
        self._values: list[str] = []
        self._end = "end"

    def root(self, shape: Message) -> None:
        self.source.begin("def decode(data)")
        self.source.line("end = len(data)")
        self.source.line("p = 0")
        value = self._message(shape)
        self._flush()
        self.source.line(f"return {value}")
        self.source.end()

    # Runs.

    def _add(self, code: str, count: int = 1) -> str:
        """Add a value to the run: returns the expression for it, which is valid after the next `_flush`."""
        self._codes.append((code, count))
        name = self.source.variable()
        self._values.append(name)
        return name

    def _skip(self) -> None:
        self._codes.append(("x", 1))

    def _flush(self) -> None:
        """Write the line that reads the added values."""
        if not self._codes:
            return
        codes, values = self._codes, self._values
        self._codes, self._values = [], []
        line = self.source.line

        def lay(offset: int) -> Any:
            return lay_out(codes, offset, self._order, self._alignment)

        if self._offset is not None:
            run = lay(self._offset)
            unpack, moved = self.source.constant(run.struct.unpack_from), str(run.size)
            self._offset = (self._offset + run.size) % 8
        else:
            runs = [lay(offset) for offset in range(8)]
            sizes = [run.size for run in runs]
            same = len(set(sizes)) == 1
            unpack = self.source.constant(tuple(run.struct.unpack_from for run in runs)) + "[p & 7]"
            moved = str(sizes[0]) if same else self.source.constant(tuple(sizes)) + "[p & 7]"
            ends = {(offset + size) % 8 for offset, size in enumerate(sizes)}
            if len(ends) == 1:
                self._offset = ends.pop()
        if any(count > 1 for _, count in codes):
            line(f"t = {unpack}(data, p)")
            at = 0
            counts = [count for code, count in codes if code != "x"]
            for value, count in zip(values, counts, strict=True):
                line(f"{value} = t[{at}]" if count == 1 else f"{value} = t[{at}:{at + count}]")
                at += count
        elif values:
            line(f"{', '.join(values)}, = {unpack}(data, p)")
        else:
            line(f"{unpack}(data, p)")
        line(f"p += {moved}")

    # Shapes.

    def _get(self, shape: Shape) -> str:
        """Read a value; the expression for it, which is valid after the next `_flush`."""
        match shape:
            case Primitive("string"):
                return self._string()
            case Primitive(kind):
                return self._add(CODES[kind])
            case Bytes(size, most):
                return self._bytes(size, most)
            case Sequence(Primitive(kind), size, most) if kind != "string":
                return self._numbers(kind, size, most)
            case Sequence(item, size, most):
                return self._each(item, size, most)
            case Dict(key, item):
                return self._pairs(key, item)
            case Optional(item, can_be_absent):
                return self._maybe(item, "UNSET" if can_be_absent else "None")
            case Wrapped(item):
                return self._delimited(lambda: self._get(item))
            case Json(node):
                decode = msgspec.json.Decoder(json_annotation(self._description, node)).decode
                function = self.source.constant(decode)
                return f"{function}({self._delimited(self._string)})"
            case Message():
                return self._message(shape)
        raise AssertionError(shape)

    def _count(self, least: int, most: int | None = None) -> str:
        """Read the number of elements, each of which takes at least `least` bytes."""
        name = self._add("I")
        self._flush()
        product = name if least == 1 else f"{name} * {least}"
        self.source.line(f"if {product} > {self._end} - p: short()")
        if most is not None:
            self.source.line(f"if {name} > {most}: many({name}, {most})")
        return name

    def _moved(self) -> None:
        self._offset = None

    def _string(self) -> str:
        size = self._count(1)
        name = self.source.variable()
        self.source.line(f"{name} = text(data, p, {size})")
        self.source.line(f"p += {size}")
        self._moved()
        return name

    def _bytes(self, size: int | None, most: int | None) -> str:
        if size is None:
            count = self._count(1, most)
        else:
            self._flush()
            count = str(size)
            self.source.line(f"if {count} > {self._end} - p: short()")
        name = self.source.variable()
        self.source.line(f"{name} = data[p : p + {count}]")
        self.source.line(f"p += {count}")
        self._moved()
        return name

    def _numbers(self, kind: str, size: int | None, most: int | None) -> str:
        code, width = CODES[kind], SIZES[kind]
        if size is not None and size <= _MOST_IN_RUN:
            if size > 1:
                return self._add(code, size)
            return f"({self._add(code)},)"
        name = self.source.variable()
        line = self.source.line
        if size is None:
            count = self._count(width, most)
        else:
            self._flush()
            count = str(size)
        boundary = min(width, self._alignment)
        if boundary > 1 and (size is not None or boundary > 4):
            line(f"if {count}: p += -p % {boundary}")
        line(f"if {count} * {width} > {self._end} - p: short()")
        arrays = self.source.constant(Arrays(self._order, code))
        line(f"{name} = {arrays}[{count}](data, p)")
        line(f"p += {count} * {width}")
        self._moved()
        return name

    def _each(self, item: Shape, size: int | None, most: int | None) -> str:
        def get() -> str:
            if size is None:
                count = self._count(least(item), most)
            else:
                self._flush()
                count = str(size)
                self.source.line(f"if {size * least(item)} > {self._end} - p: short()")
            self._moved()
            found = self.source.variable()
            self.source.line(f"{found} = []")
            self.source.line(f"for _ in range({count}):")
            self.source.loops += 1
            self._block(item, f"{found}.append({{}})")
            self.source.loops -= 1
            return found

        return self._with_length(get)

    def _pairs(self, key: Shape, item: Shape) -> str:
        def get() -> str:
            count = self._count(least(key) + least(item))
            self._moved()
            found = self.source.variable()
            self.source.line(f"{found} = {{}}")
            self.source.line(f"for _ in range({count}):")
            self.source.loops += 1
            self.source.indent()

            def pair() -> str:
                first = self._one(key)
                second = self._one(item)
                return f"{found}[{f'bytes({first})' if isinstance(key, Bytes) else first}] = {second}"

            text = self._delimited(pair)
            self._flush()
            self.source.line(text)
            self._moved()
            self.source.indent(-1)
            self.source.loops -= 1
            return found

        return self._with_length(get)

    def _maybe(self, item: Shape, nothing: str) -> str:
        def get() -> str:
            count = self._count(least(item), 1)
            self._moved()
            found = self.source.variable()
            self.source.line(f"{found} = {nothing}")
            self.source.line(f"if {count}:")
            self._block(item, f"{found} = {{}}")
            return found

        return get() if isinstance(item, Primitive) and item.kind != "string" else self._with_length(get)

    def _block(self, item: Shape, use: str) -> None:
        self.source.indent()
        value = self._one(item)
        self._flush()
        self.source.line(use.format(value))
        self._moved()
        self.source.indent(-1)

    def _one(self, shape: Shape) -> str:
        return self._get(shape) if self.source.has_room(shape) else self._call(shape)

    def _message(self, shape: Message) -> str:
        def get() -> str:
            if not shape.shapes:
                self._skip()
            return self._made(shape, [self._one(part) for part in shape.shapes])

        return self._delimited(get)

    def _made(self, shape: Message, values: list[str]) -> str:
        tag = self.source.constant(shape.tag) if shape.tag is not None else None
        if shape.is_array:
            values = values if tag is None else [tag, *values]
            return f"({', '.join(values)}{',' * (len(values) == 1)})"
        keys = [self.source.constant(key) for key in shape.keys]
        if tag is not None:
            keys, values = [self.source.constant(shape.tag_field or "type"), *keys], [tag, *values]
        made = "{" + ", ".join(f"{key}: {value}" for key, value in zip(keys, values, strict=True)) + "}"
        absent = any(isinstance(part, Optional) and part.can_be_absent for part in shape.shapes)
        return f"without({made})" if absent else made

    def _delimited(self, get: Callable[[], str]) -> str:
        return self._limited(get) if self._is_delimited else get()

    def _with_length(self, get: Callable[[], str]) -> str:
        return self._limited(get) if self._is_second else get()

    def _limited(self, get: Callable[[], str]) -> str:
        """Read a value that begins with its length; bytes behind its known fields are skipped."""
        size = self._count(1)
        end, outer = self.source.variable(), self._end
        self.source.line(f"{end} = p + {size}")
        self._end = end
        value = get()
        self._flush()
        self.source.line(f"if p > {end}: short()")
        self.source.line(f"p = {end}")
        self._moved()
        self._end = outer
        return value

    def _call(self, shape: Shape) -> str:
        self._flush()
        functions = self.source.functions
        if shape not in functions:
            functions[shape] = function = self.source.variable()
            outer = self._end
            self._offset, self._end = None, "end"
            self.source.begin(f"def {function}(data, p, end)")
            value = self._get(shape)
            self._flush()
            self.source.line(f"return {value}, p")
            self.source.end()
            self._end = outer
        name = self.source.variable()
        self.source.line(f"{name}, p = {functions[shape]}(data, p, {self._end})")
        self._moved()
        return name


def _text(data: Buffer, start: int, size: int) -> str:
    """A text of `size` bytes. The last byte should be zero. Invalid UTF-8 is replaced, as in rclpy."""
    end = start + size
    if size and not data[end - 1]:
        end -= 1
    return str(data[start:end], "utf-8", "replace")


def _without(fields: dict[str, Any]) -> dict[str, Any]:
    """A map without its unset fields."""
    return {key: value for key, value in fields.items() if value is not UNSET}


def _short() -> None:
    raise ValueError("it ends before what it announces")


def _many(count: int, most: int) -> None:
    raise ValueError(f"a sequence of at most {most} elements has {count}")
