"""A decoded message as JSON for the page: a tree with long parts folded. Pure.

Objects, texts, numbers and truth values are as in JSON. A value that JSON does not have is an object with one
key that begins with `$`, as no field's name does:

    {"$array": 36, "head": [0.1, ...]}     36 elements, of which these are the first
    {"$bytes": 4096, "head": "00ff.."}     as many octets, the first as hexadecimal digits
    {"$text": 5000, "head": "..."}         as many characters
    {"$number": "nan"}                     a number that JSON does not have, or one too long for a browser's
    {"$map": [...], "length": 36}          a dict of 36, of which these are the first pairs of key and value
    {"$image": {...}}                      a picture (`bus_web.pictures`)
    {"$folded": "as deep as that"}         too deep, or too much
"""

from collections.abc import Collection, Iterable
from itertools import islice
from math import isfinite
from typing import Any

import msgspec

from bus_web.pictures import picture_of

__all__ = ["MOST_OPEN", "tree_of"]

_FOLD = 8
"""Longer arrays are folded: covariances would bury the rest."""
MOST_OPEN = 1000
"""An array that the reader has opened shows at most so many elements."""
_MOST_TEXT = 1000
_MOST_BYTES = 32
_MOST_DEPTH = 24
_MOST_PARTS = 20_000
"""Limit for one whole message; so the frames queued for a page are never much larger than its outbox."""
_PART_BYTES = 100
"""Texts and pictures count as a part for each of so many bytes."""
_EXACT = 1 << 53
_FOLDED = {"$folded": "too much to show"}


def tree_of(message: Any, opened: Collection[str] = ()) -> Any:
    """`opened`: paths of arrays to be shown at length, such as `pose.covariance` or `tracks.3.points`."""
    return _Tree(opened).tree(message, "", 0)


class _Tree:
    def __init__(self, opened: Collection[str]) -> None:
        self._opened = opened
        self._left = _MOST_PARTS

    def tree(self, value: Any, path: str, depth: int) -> Any:
        self._left -= 1
        match value:
            case None | bool():
                return value
            case str():
                return self._text(value)
            case int():
                return value if -_EXACT < value < _EXACT else {"$number": str(value)}
            case float():
                return value if isfinite(value) else {"$number": str(value)}
            case bytes() | bytearray() | memoryview():
                return {"$bytes": len(value), "head": bytes(value[:_MOST_BYTES]).hex()}
        if depth == _MOST_DEPTH or self._left < 0:
            return _FOLDED
        match value:
            case msgspec.Struct():
                return self._struct(value, path, depth)
            case dict():
                shown = islice(value.items(), self._most(path))
                pairs = [
                    [self.tree(key, path, depth + 1), self.tree(of, f"{path}.{key}", depth + 1)]
                    for key, of in shown
                ]
                return {"$map": pairs, "length": len(value)}
            case list() | tuple() | set() | frozenset():
                return self._array(value, len(value), path, depth)
        if hasattr(value, "__len__") and hasattr(value, "__iter__"):  # an array of some library
            return self._array(value, len(value), path, depth)
        return str(value)

    def _text(self, value: str) -> Any:
        head = value[:_MOST_TEXT]
        self._left -= len(head) // _PART_BYTES
        if self._left < 0:
            return _FOLDED
        return value if len(value) <= _MOST_TEXT else {"$text": len(value), "head": head}

    def _struct(self, value: msgspec.Struct, path: str, depth: int) -> Any:
        parts = {}
        for name in value.__struct_fields__:
            part = getattr(value, name)
            if part is not msgspec.UNSET:
                parts[name] = self.tree(part, f"{path}.{name}" if path else name, depth + 1)
        picture = picture_of(value)
        if picture is not None:
            self._left -= len(picture["data" if "data" in picture else "rgb"]) // _PART_BYTES
            parts["data"] = _FOLDED if self._left < 0 else {"$image": picture}
        return parts

    def _array(self, value: Iterable[Any], length: int, path: str, depth: int) -> Any:
        most = self._most(path)
        shown = [
            self.tree(part, f"{path}.{number}", depth + 1) for number, part in enumerate(islice(value, most))
        ]
        return shown if length <= _FOLD else {"$array": length, "head": shown}

    def _most(self, path: str) -> int:
        return MOST_OPEN if path in self._opened else _FOLD
