"""Bounds the values that a message gets without having sent them: left-out fields get their defaults.

A list of thousand empty structs of thousand fields has thousand bytes and a million values. For another
process's type, the number is bounded before anything is decoded. Owns: the number of such values in a
message. Must not know: the origin of types, topics, the wire.

Each sent value has at least one byte, so only left-out fields of structs in containers count here. A struct
counts as its number of fields less its bytes, so an honest message of any length counts as 0.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeVar

import msgspec
from msgspec import Raw, Struct

from bus.types.schema_form import Node, Type

__all__ = ["MOST_UNSENT", "Unsent"]

MOST_UNSENT: Final = 1_000_000
"""Most values of one message that its sender may leave out."""

_NIL: Final = 0xC0
_LEFT_OUT: Final = f"more than {MOST_UNSENT:,} values are left out in it, which would be filled in"

M = TypeVar("M")


class _TooManyError(Exception):
    """The message has more left-out values than allowed."""


class Unsent:
    """Counts left-out values in messages of one type.

    `values`: by the name of each type, the number of values in an empty struct.
    """

    def __init__(self, types: Mapping[str, Type], values: Mapping[str, int], root: str) -> None:
        self._types = types
        self._values = values
        self._root = root
        self._weights: dict[str, int] = {}
        self._shadows: dict[str, msgspec.msgpack.Decoder[Any]] = {}
        self.most_per_byte: Final = self._weight(root)
        """Most left-out values for each byte of a message. 0: there are none."""

    def bounded(self, decode: Callable[[Any], M]) -> Callable[[Any], M]:
        """`decode` with a bound: raises msgspec.ValidationError for more than MOST_UNSENT left-out values."""
        if not self.most_per_byte:
            return decode
        fits_surely = MOST_UNSENT // self.most_per_byte

        def decode_bounded(data: Any) -> M:
            if len(data) > fits_surely:
                self.check(data)
            return decode(data)

        return decode_bounded

    def check(self, data: Any) -> None:
        """Raise msgspec.ValidationError if `data` has more than MOST_UNSENT left-out values."""
        try:
            self._count(self._root, data, MOST_UNSENT)
        except _TooManyError:
            raise msgspec.ValidationError(_LEFT_OUT) from None

    def count(self, node: Node, data: bytes) -> int | None:
        """A lower bound of the left-out values in a value of type `node`; None: more than MOST_UNSENT."""
        try:
            return self._count(node, data, MOST_UNSENT)
        except _TooManyError:
            return None

    def _count(self, node: Node, data: Any, room: int) -> int:
        """As `count`, with the limit `room`. Undecodable data counts as 0, because it is refused anyway."""
        weight, length = self._weight(node), _size(data)
        if weight * length <= room:
            return weight * length
        try:
            return self._inspect(node, data, room)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return 0

    def _inspect(self, node: Node, data: Any, room: int) -> int:
        match node:
            case str():
                parts = self._shadow(node).decode(data)
                pairs = ((one.type, getattr(parts, one.name)) for one in self._types[node].fields)
                return self._sum(((kind, part) for kind, part in pairs if part is not None), room)
            case ["list", item, *_]:
                return self._items(item, msgspec.msgpack.decode(data, type=list[Raw]), room)
            case ["dict", _, item]:
                return self._items(
                    item, list(msgspec.msgpack.decode(data, type=dict[Any, Raw]).values()), room
                )
            case ["tuple", *items]:
                parts = msgspec.msgpack.decode(data, type=list[Raw])
                return self._sum(zip(items, parts, strict=False), room)
            case ["union", *members] if memoryview(data)[0] != _NIL:
                return max(self._count(member, data, room) for member in members)
        return 0

    def _items(self, item: Node, parts: list[Raw], room: int) -> int:
        """The count for the items of a container."""
        values = self._values_of(item)
        short = [part for part in parts if _size(part) < values]
        if isinstance(item, list) and item[0] == "union":
            values_of_short = [self._values_in(item, part) for part in short]
        else:
            values_of_short = [values] * len(short)
        total = sum([max(0, of - _size(part)) for of, part in zip(values_of_short, short, strict=True)])
        if total > room:
            raise _TooManyError
        return self._sum(((item, part) for part in parts), room, total) if self._weight(item) else total

    def _sum(self, parts: Iterable[tuple[Node, Any]], room: int, total: int = 0) -> int:
        for node, part in parts:
            total += self._count(node, part, room - total)
            if total > room:
                raise _TooManyError
        return total

    def _values_in(self, union: list[Any], part: Raw) -> int:
        """As `_values_of`, for the possible members of the union."""
        most = 1
        for member in union[1:]:
            if isinstance(member, str) and member in self._types:
                try:
                    self._shadow(member).decode(part)
                except (msgspec.DecodeError, UnicodeDecodeError):
                    continue
            most = max(most, self._values_of(member))
        return most

    def _values_of(self, node: Node) -> int:
        """The most values of one item with a single byte."""
        match node:
            case str():
                return self._values.get(node, 1)
            case ["tuple" | "union", *members]:
                return max(map(self._values_of, members), default=1)
        return 1

    def _weight(self, node: Node) -> int:
        """The most left-out values for one byte of a value of this type."""
        match node:
            case str() if node in self._types:
                if node not in self._weights:
                    weights = [self._weight(field.type) for field in self._types[node].fields]
                    self._weights[node] = max(weights, default=0)
                return self._weights[node]
            case ["list", item, *_] | ["dict", _, item]:
                return max(self._values_of(item) - 1, self._weight(item))
            case ["tuple" | "union", *members]:
                return max(map(self._weight, members), default=0)
        return 0

    def _shadow(self, name: str) -> msgspec.msgpack.Decoder[Any]:
        """A decoder for a struct of that type that leaves its fields undecoded; left-out fields are None."""
        if name not in self._shadows:
            described = self._types[name]
            cls: type[Struct] = msgspec.defstruct(
                "Shadow",
                [(field.name, Raw, None) for field in described.fields],
                array_like=described.array,
                kw_only=True,
                rename={field.name: field.key for field in described.fields if field.key is not None},
                tag=described.tag,
                tag_field=described.tag_field,
            )
            self._shadows[name] = msgspec.msgpack.Decoder(cls)
        return self._shadows[name]


def _size(data: Any) -> int:
    return memoryview(data).nbytes
