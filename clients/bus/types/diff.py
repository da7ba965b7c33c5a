"""Describes the difference between two descriptions of one type, in words for its authors.

Owns: the comparison and its text. Must not know: classes, topics, the use of the text. Both descriptions may
come from other processes, so nothing in them is trusted.
"""

from itertools import zip_longest
from typing import Any, Final

import msgspec

from bus.base.printable import printable
from bus.types.schema_form import Field, Form, Node, Type

__all__ = ["difference"]

_LONGEST: Final = 200
"""Most characters shown of a field's path or type."""

_LONGEST_TEXT: Final = 1000
"""Most characters of the whole text."""

_DIGEST: Final = 17
"""Characters after the name of a service's message, see `bus.types.service`."""


def difference(publisher: bytes, subscription: bytes, ends: tuple[str, str] | None = None) -> str | None:
    """The first field that differs: `field 'pose.x' is float64 at the publisher and float32 at ...`.

    Both are encoded descriptions (`schema`, in MessagePack); `ends` are the names of their owners.
    None if one of them is broken, or nothing relevant differs.
    """
    try:
        one, other = (msgspec.msgpack.decode(data, type=Form) for data in (publisher, subscription))
        starts = _start(one), _start(other)
        found = _Comparison(one, other, ends or _ends(one)).types(*starts, "")
    except (ValueError, LookupError, TypeError, RecursionError):
        return None
    if found is None and starts[0] != starts[1] and starts != (one.root, other.root):
        # The name of each half of a service contains a digest of both halves.
        half = "response" if one.root.endswith("_Request") else "request"
        found = f"the definitions of the {half} differ"
    return None if found is None else printable(found[:_LONGEST_TEXT], keep="")


class _Comparison:
    """The comparison of two descriptions; each pair of their types is compared once."""

    def __init__(self, one: Form, other: Form, ends: tuple[str, str]) -> None:
        self._ends = ends
        self._one = one.types
        self._other = other.types
        self._seen: set[tuple[str, str]] = set()

    def types(self, one_name: str, other_name: str, path: str) -> str | None:
        if (one_name, other_name) in self._seen:
            return None
        self._seen.add((one_name, other_name))
        one, other = self._one[one_name], self._other[other_name]
        if _form(one) != _form(other):
            return self._differs("the whole", path, _form(one), _form(other))
        names = {field.name for field in one.fields}, {field.name for field in other.fields}
        for number, (mine, its) in enumerate(zip_longest(one.fields, other.fields), 1):
            if mine is not None and mine.name not in names[1]:
                return f"only {self._ends[0]} has a field {_shown(mine, path)}"
            if its is not None and its.name not in names[0]:
                return f"only {self._ends[1]} has a field {_shown(its, path)}"
            if mine is None or its is None:
                return None  # a name occurs twice there
            if mine.name != its.name:
                names_here = f"'{mine.name}'", f"'{its.name}'"
                return self._differs(f"number {number} of the fields", path, *names_here)
            found = self._fields(mine, its, _joined(path, mine.name))
            if found is not None:
                return found
        return None

    def _fields(self, one: Field, other: Field, path: str) -> str | None:
        keys = one.key or one.name, other.key or other.name
        if keys[0] != keys[1]:
            return self._differs("the name on the wire", path, f"'{keys[0]}'", f"'{keys[1]}'")
        return self._nodes(one.type, other.type, path)

    def _nodes(self, one: Node, other: Node, path: str) -> str | None:
        if isinstance(one, str) and one == other:
            return self.types(one, one, path) if "/" in one else None
        if isinstance(one, list) and isinstance(other, list) and _is_alike(one, other):
            below = f"{path}[]" if one[0] == "list" else path
            pairs = zip(one[1:], other[1:], strict=True)
            nodes = [pair for pair in pairs if isinstance(pair[0], str | list)]
            return next(filter(None, (self._nodes(mine, its, below) for mine, its in nodes)), None)
        return None if one == other else self._differs("", path, _text(one), _text(other))

    def _differs(self, what: str, path: str, one: str, other: str) -> str:
        field = f"field '{path:.{_LONGEST}}'" if path else ""
        subject = f"{what} of {field}" if what and field else what or field
        return f"{subject} is {one} at {self._ends[0]} and {other} at {self._ends[1]}"


def _start(form: Form) -> str:
    """The message that the user knows: for a service, the message in the envelope."""
    inner = [name for name in form.types if name[:-_DIGEST] == form.root]
    return inner[0] if "/srv/" in form.root and len(inner) == 1 else form.root


def _ends(publisher: Form) -> tuple[str, str]:
    """The names of the two ends in the text."""
    if _start(publisher) == publisher.root:
        return "the publisher", "the subscription"
    return (
        ("the client", "the server") if publisher.root.endswith("_Request") else ("the server", "the client")
    )


def _is_alike(one: list[Any], other: list[Any]) -> bool:
    """Whether two different types are of one kind, and so can only differ in their parts."""
    return (
        len(one) == len(other)
        and one[0] != "literal"
        and all(
            mine == its or (isinstance(mine, list) and isinstance(its, list))
            for mine, its in zip(one, other, strict=True)
        )
    )


def _form(type_: Type) -> str:
    tag = "" if type_.tag is None else f" with the tag {type_.tag!r} as {type_.tag_field!r}"
    return f"{'an array (array_like)' if type_.array else 'a map'}{tag}"


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _shown(field: Field, path: str) -> str:
    return f"'{_joined(path, field.name):.{_LONGEST}}' ({_text(field.type)})"


def _text(node: Any) -> str:
    """A type in the form that its author may have used."""
    match node:
        case ["list", item]:
            text = f"{_text(item)}[]"
        case ["list", item, least, most]:
            text = f"{_text(item)}[{_bounds(least, most)}]"
        case ["bytes", least, most, *_]:
            text = f"bytes[{_bounds(least, most)}]"
        case ["string" | "wstring" as kind, most]:
            text = f"{kind}<={most}"
        case ["wstring"]:
            text = "wstring"
        case ["union", *members]:
            text = " | ".join(map(_text, members))
        case [kind, *parts]:
            text = f"{kind}[{', '.join(map(_text, parts))}]"
        case "uint8[]":
            text = "bytes"  # a list of uint8 has another form on the wire
        case _:
            text = str(node)
    return f"{text:.{_LONGEST}}"


def _bounds(least: Any, most: Any) -> str:
    if least == most:
        return str(most)
    return f"<={most}" if not least else f">={least}" if most is None else f"{least} to {most}"
