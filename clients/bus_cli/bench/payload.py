"""Messages of a given size with stamps at the front: making them, and reading their stamps.

Owns the layout of the stamps. Must not know nodes, topics or processes.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Final, NamedTuple

import msgspec

from bus.errors import ConfigurationError
from bus.types.schema import Node
from bus.types.support import find_type, type_support
from bus_cli.output import CommandError
from bus_cli.query import full_type_name

__all__ = ["BYTES", "HEAD", "MARK", "Payload", "Stamps", "read_stamps"]

BYTES: Final = "bytes"
"""Users may write this for the simplest type with bytes."""
HEAD: Final = 32
"""Number of elements of the stamps: a mark, the due time and the sending time."""
MARK: Final = "@"
"""The first element of a stamped message. No other message begins with it."""

_ALIASES = {BYTES: "std_msgs/msg/UInt8MultiArray"}
_FILLING = "The quick brown fox jumps over the lazy dog. "
_WIDTHS = {
    **dict.fromkeys(("int8", "uint8", "char"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64", "int"), 8),
}


class Stamps(NamedTuple):
    """Times in a message, in ns of CLOCK_MONOTONIC."""

    due_ns: int
    sent_ns: int


class Payload:
    """Messages of the type `name`, whose sized field has `size` bytes.

    The sized field is the first field of bytes, else the first text, else the first list of numbers. The
    stamps are ASCII in each of them. Raises CommandError for an unknown type, a type without such a field,
    and an impossible size.
    """

    def __init__(self, name: str, size: int) -> None:
        self.name = _ALIASES.get(name) or full_type_name(name)
        self.type = _class(self.name)
        self.field, node = _sized_field(self.name, self.type)
        self.size = size
        self.get: Callable[[Any], Sequence[Any]] = attrgetter(self.field)
        """Returns the sized field of a message."""
        self._put = _putter(node)
        self.mark: Any = self._put(MARK)[0]
        width = _WIDTHS[node[1]] if isinstance(node, list) else 1
        if size < HEAD * width:
            raise CommandError(
                f"--size {size}: the smallest for {self.name} is {HEAD * width} B, for the stamps in it"
            )
        if size % width:
            raise CommandError(f"--size {size}: {self.name}.{self.field} has elements of {width} B each")
        count = size // width
        plain = self._put((_FILLING * (count // len(_FILLING) + 1))[:count])
        self._tail = plain[HEAD:]
        template: Any = self.type(**{self.field: plain})
        self.plain: Callable[[], msgspec.Struct] = template.__copy__
        """Makes a message without stamps: always a new object with the same contents."""

    def stamped(self, due_ns: int, sent_ns: int) -> msgspec.Struct:
        """Make a message with stamps."""
        head = self._put(f"{MARK}{due_ns:015x}{sent_ns:016x}")
        return self.type(**{self.field: head + self._tail})


def read_stamps(head: Sequence[Any]) -> Stamps:
    """Read the stamps from the first `HEAD` elements of the sized field of a stamped message."""
    text = head if isinstance(head, str) else bytes(map(int, head)).decode()
    return Stamps(int(text[1:16], 16), int(text[16:HEAD], 16))


def _class(name: str) -> type[msgspec.Struct]:
    try:
        found = find_type(name)
    except ConfigurationError as error:
        raise CommandError(f"--type {name}: {error}") from None
    if found is None:
        raise CommandError(f"--type {name}: there is no such message type (see: bus interface list -m)")
    return found


def _sized_field(name: str, cls: type[msgspec.Struct]) -> tuple[str, Node]:
    """The name of the sized field, and its type in the schema."""
    schema = type_support(cls).schema
    fields = [(field["name"], field["type"]) for field in schema["types"][schema["root"]]["fields"]]
    for fits in (_is_octets, _is_text, _is_numbers):
        for field, node in fields:
            if fits(node):
                return field, node
    raise CommandError(f"--type {name}: it has no field of bytes, text or numbers with a variable length")


def _is_octets(node: Node) -> bool:
    return node in ("uint8[]", "byte[]")


def _is_text(node: Node) -> bool:
    return node == "string"


def _is_numbers(node: Node) -> bool:
    return isinstance(node, list) and len(node) == 2 and node[0] == "list" and node[1] in _WIDTHS


def _putter(node: Node) -> Callable[[str], Any]:
    """A function that converts ASCII to the contents of such a field."""
    if not isinstance(node, list):
        return str if _is_text(node) else str.encode
    number = float if node[1].startswith("float") else int
    return lambda text: [number(code) for code in text.encode()]
