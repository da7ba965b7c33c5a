"""From MessagePack payloads to CDR: one function for each type, generated as source and compiled.

Owns: little-endian XCDR1, the encoding that ROS 2 sends. Must not know: definitions, the other direction.

One call packs consecutive primitives, also across nested messages. If their offset depends on the message
(for example behind a string), there are eight such calls, one for each offset. In generated source, `p` is
then the position, modulo 8.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
from msgspec import UNSET, Raw

from bus.wire.runs import Buffer
from bus_ros.cdr.annotations import Annotations, field_name, json_annotation
from bus_ros.cdr.layout import CODES, Runs, lay_out
from bus_ros.cdr.shapes import Bytes, Dict, Json, Message, Optional, Primitive, Sequence, Shape, Wrapped
from bus_ros.cdr.source import Source

__all__ = ["LONG", "encoder"]

LONG: Final = 16 << 10
"""A field of this length or more is a separate part, a view of the payload."""

_ENCAPSULATION: Final = 0x0100
"""The bytes 00 01 00 00, as a little-endian number."""


def encoder(description: Mapping[str, Any], shape: Message, views: bool) -> Callable[[Buffer], Any]:
    """A function that converts a payload to a CDR message.

    With `views`, the function returns parts, and each long field is a separate part, a view of the payload.
    Without, it returns the whole message as bytes. It raises ValueError (msgspec.DecodeError), struct.error,
    OverflowError or TypeError if the payload is not a message of the type.
    """
    decoder: Any = msgspec.msgpack.Decoder(Annotations(description, views).of(shape))
    writer = _Writer(description, views)
    writer.root(shape)
    made = writer.source.compile(shape.name)
    made["unpack"] = decoder.decode
    encode: Callable[[Buffer], Any] = made["encode"]
    return encode


class _Writer:
    def __init__(self, description: Mapping[str, Any], views: bool) -> None:
        self.source = Source(text=_text, join=b"".join, adder=_adder, UNSET=UNSET)
        self._description = description
        self._views = views
        self._offset: int | None = None
        """The offset of the next write, modulo 8; None: `_place` has it."""
        self._place = "p"
        """An expression for the offset; `_into_p` writes a line that assigns it to `p`."""
        self._codes: list[tuple[str, int]] = []
        self._values: list[str] = []
        self._parts: list[str] = []
        """Parts made by the generated lines, but not yet in the list `out`."""
        self._has_list = False

    def root(self, shape: Message) -> None:
        line = self.source.line
        self.source.begin("def encode(payload)")
        line("v = unpack(payload)")
        if self._views:
            line("parts = []")
            line("add = adder(parts, out)")
            self._has_list = True
        # The encapsulation is a part of the first run, and positions count from behind it.
        self._offset = 4
        self._add("I", str(_ENCAPSULATION))
        self._message(shape, "v")
        self._flush()
        if self._has_list:
            self._settle()
            self.source.first("add = None")
            self.source.first("out = []")
        if not self._views:
            line(f"return join({'out' if self._has_list else self._taken()})")
        else:
            line("if out: parts.append(join(out))")
            line("return parts")
        self.source.end()

    # Runs.

    def _add(self, code: str, value: str, count: int = 1) -> None:
        self._codes.append((code, count))
        if value:
            self._values.append(value)

    def _flush(self) -> None:
        """Write the line that packs the added values."""
        if not self._codes:
            return
        codes, values = self._codes, ", ".join(self._values)
        self._codes, self._values = [], []
        if not values:
            zeros = bytes(len(codes))
            self._parts.append(self.source.constant(zeros))
            self._moved(len(zeros))
            return
        name = self.source.variable()
        self._parts.append(name)
        if self._offset is not None:
            run = lay_out(codes, self._offset)
            self.source.line(f"{name} = {self.source.constant(run.struct.pack)}({values})")
            self._moved(run.size)
            return
        self._into_p()
        runs = [lay_out(codes, offset) for offset in range(8)]
        packs = self.source.constant(tuple(run.struct.pack for run in runs))
        self.source.line(f"{name} = {packs}[p & 7]({values})")
        ends = [(offset + run.size) % 8 for offset, run in enumerate(runs)]
        if len(set(ends)) == 1:
            self._offset = ends[0]
        elif len({run.size for run in runs}) == 1:
            self._moved(runs[0].size)
        else:
            self._place = f"{self.source.constant(tuple(ends))}[p & 7]"

    def _pause(self) -> None:
        """Finish all pending lines: a loop, a branch or a call comes next, or their end."""
        self._flush()
        self._settle()
        self._into_p()

    def _taken(self) -> str:
        """The parts that are not in a list yet; clears them."""
        parts, self._parts = self._parts, []
        return f"({', '.join(parts)}{',' * (len(parts) == 1)})"

    def _settle(self) -> None:
        """Write the line that moves all pending parts into `out`."""
        if self._parts:
            self.source.line(f"out += {self._taken()}")
            self._has_list = True

    def _into_p(self) -> None:
        """Write the line that puts the position into `p`."""
        if self._offset is not None:
            self._place = str(self._offset)
        if self._place != "p":
            self.source.line(f"p = {self._place}")
        self._offset, self._place = None, "p"

    def _moved(self, by: int | str) -> None:
        """Advance the offset by a length; a text is an expression for a length that varies."""
        if self._offset is None:
            self._place += f" + {by}"
        elif isinstance(by, int):
            self._offset = (self._offset + by) % 8
        else:
            self._offset, self._place = None, f"{self._offset} + {by}"

    # Shapes.

    def _put(self, shape: Shape, value: str) -> None:
        match shape:
            case Primitive("string"):
                name = self.source.variable()
                self.source.line(f"{name} = text({value})" if self._views else f"{name} = {value}.encode()")
                self._string(name)
            case Primitive(kind):
                self._add(CODES[kind], value)
            case Bytes(size):
                self._bytes(size, value)
            case Sequence(Primitive(kind), size) if kind != "string":
                self._numbers(kind, size, value)
            case Sequence(item, size):
                if size is None:
                    self._add("I", f"len({value})")
                self._each(item, value)
            case Dict(key, item):
                self._add("I", f"len({value})")
                self._pairs(key, item, value)
            case Optional(item, can_be_absent):
                self._maybe(item, "UNSET" if can_be_absent else "None", value)
            case Wrapped(item):
                self._put(item, value)
            case Json(node):
                name = self.source.variable()
                to_json = self.source.constant(_json_encoder(self._description, node))
                self.source.line(f"{name} = {to_json}({value})")
                self._string(name)
            case Message():
                self._message(shape, value)

    def _string(self, name: str) -> None:
        """Append a text that is already bytes. The zero at its end belongs to the next run."""
        self._add("I", f"len({name}) + 1")
        self._flush()
        self._blob(name)
        self._moved(f"len({name})")
        self._add("x", "")

    def _bytes(self, size: int | None, value: str) -> None:
        if size is None:
            self._add("I", f"len({value})")
        self._flush()
        self._blob(value)
        self._moved(f"len({value})" if size is None else size)

    def _blob(self, value: str) -> None:
        if self._views:
            self._settle()
            self.source.line(f"add({value})")
        else:
            self._parts.append(value)

    def _numbers(self, kind: str, size: int | None, value: str) -> None:
        if size is not None:
            self._add(CODES[kind], f"*{value}", size)
            return
        count, pack, name = (self.source.variable() for _ in range(3))
        self._add("I", count)
        runs = self.source.constant(Runs(self._codes, CODES[kind]))
        if self._offset is None:
            self._into_p()
        offset = "p & 7" if self._offset is None else self._offset
        self.source.line(f"{count} = len({value})")
        self.source.line(f"{pack}, p = {runs}[{count} << 3 | {offset}]")
        self.source.line(f"{name} = {pack}({', '.join(self._values)}, *{value})")
        self._codes, self._values = [], []
        self._offset, self._place = None, "p"
        self._blob(name)

    def _each(self, item: Shape, value: str) -> None:
        self._pause()
        name = self.source.variable()
        self.source.line(f"for {name} in {value}:")
        self.source.loops += 1
        self._block((item, name))
        self.source.loops -= 1

    def _pairs(self, key: Shape, item: Shape, value: str) -> None:
        self._pause()
        first, second = self.source.variable(), self.source.variable()
        self.source.line(f"for {first}, {second} in {value}.items():")
        self.source.loops += 1
        self._block((key, first), (item, second))
        self.source.loops -= 1

    def _maybe(self, item: Shape, nothing: str, value: str) -> None:
        self._pause()
        name = self.source.variable()
        self.source.line(f"{name} = {value}")
        self.source.line(f"if {name} is {nothing}:")
        self._add("I", "0")
        self._block()
        self.source.line("else:")
        self._add("I", "1")
        self._block((item, name))

    def _block(self, *values: tuple[Shape, str]) -> None:
        """Write the body of a loop or a branch: the position is in `p` before and behind it."""
        self.source.indent()
        for shape, value in values:
            self._one(shape, value)
        self._pause()
        self.source.indent(-1)

    def _message(self, shape: Message, value: str) -> None:
        if not shape.shapes:
            self._add("x", "")
            return
        names = [self.source.variable() for _ in shape.shapes]
        if shape.is_array:
            tag = ["_"] if shape.tag is not None else []
            self.source.line(f"{', '.join([*tag, *names])}, = {value}")
        else:
            for index, name in enumerate(names):
                self.source.line(f"{name} = {value}.{field_name(index)}")
        for name, part in zip(names, shape.shapes, strict=True):
            self._one(part, name)

    def _one(self, shape: Shape, value: str) -> None:
        if self.source.has_room(shape):
            self._put(shape, value)
        else:
            self._call(shape, value)

    def _call(self, shape: Shape, value: str) -> None:
        self._pause()
        functions = self.source.functions
        if shape not in functions:
            functions[shape] = name = self.source.variable()
            self.source.begin(f"def {name}(v, out, add, p)")
            self._put(shape, "v")
            self._pause()
            self.source.line("return p")
            self.source.end()
        self.source.line(f"p = {functions[shape]}({value}, out, add, p)")


def _adder(parts: list[Buffer], out: list[Buffer]) -> Callable[[Buffer], None]:
    def add(part: Buffer) -> None:
        """Make a long part separate, and join the short parts before it."""
        if len(part) < LONG:
            out.append(part)
        else:
            parts.append(b"".join(out))
            out.clear()
            parts.append(part)

    return add


def _json_encoder(description: Mapping[str, Any], node: Any) -> Callable[[Any], bytes]:
    if node == "any":
        return msgspec.json.encode
    check = msgspec.json.Decoder(json_annotation(description, node)).decode

    def encode(value: Any) -> bytes:
        text = msgspec.json.encode(value)
        if b"null" in text:
            check(text)  # JSON has no NaN: it would be null, which can't be read back
        return text

    return encode


def _text(value: Raw | str | bytes) -> Buffer:
    """The bytes of a text: a view of the payload."""
    if isinstance(value, str):
        return value.encode()
    view = memoryview(value)
    head = view[0]
    if 0xA0 <= head <= 0xBF:
        return view[1:]
    if 0xD9 <= head <= 0xDB:
        return view[1 + (1 << (head - 0xD9)) :]
    raise TypeError("Expected `str`")
