"""The least and the greatest value of plotted numbers between two messages that a page shows. Pure.

A page shows at most 20 messages of a topic in a second. Its plots have a line from the least to the
greatest value of the messages between, so no spike is missed.
"""

from collections.abc import Iterable, Sequence
from math import isfinite
from typing import Any, NamedTuple

import msgspec

__all__ = ["MOST_PLOTTED", "Extremes", "Range"]

MOST_PLOTTED = 8
"""Numbers of one topic; a plot of our page has five."""
_MOST_MESSAGES = 64
_MOST_BYTES = 1 << 20
"""Limits between two messages that the page shows: each of these is decoded."""
_MOST_DIGITS = 9
_EXACT = 1 << 53


class Range(NamedTuple):
    """Values of the messages since the last one shown."""

    from_ns: int
    """When the first of them was published."""
    ends: tuple[tuple[str, float, float], ...]
    """The path of each number, its least and its greatest value, in the order in which they came."""


class Extremes:
    """Collects the messages of one topic.

    `paths`: the plotted numbers, such as `angular_velocity.z` or `ranges.3`.
    """

    def __init__(self, paths: Iterable[str] = ()) -> None:
        chosen = sorted({*paths})[:MOST_PLOTTED]
        self.paths = frozenset(chosen)
        self._names = {path: path.split(".") for path in chosen}
        self._count = self._bytes = self._from_ns = 0
        self._pairs: dict[str, tuple[float, float]] = {}

    def has_room(self, size: int) -> bool:
        """Whether a message of `size` bytes should be decoded and added."""
        return bool(self._names) and self._count < _MOST_MESSAGES and self._bytes + size <= _MOST_BYTES

    def add(self, message: Any, size: int, at_ns: int) -> None:
        """A message of `size` bytes that was published at `at_ns`."""
        if not self._count:
            self._from_ns = at_ns
        self._count += 1
        self._bytes += size
        for path, names in self._names.items():
            value = _number_at(message, names)
            if value is None:
                continue
            pair = self._pairs.get(path)
            if pair is None:
                self._pairs[path] = (value, value)
            else:
                self._pairs[path] = _widened(pair, value)

    def take(self) -> Range | None:
        """The values collected since the last call; None for fewer than two messages."""
        found = None
        if self._count > 1 and self._pairs:
            found = Range(self._from_ns, tuple([(path, *pair) for path, pair in self._pairs.items()]))
        self.clear()
        return found

    def clear(self) -> None:
        """Forget the collected values."""
        self._count = self._bytes = self._from_ns = 0
        self._pairs = {}


def _widened(pair: tuple[float, float], value: float) -> tuple[float, float]:
    """A new extreme is later than the other one."""
    least, greatest = sorted(pair)
    if value < least:
        return greatest, value
    if value > greatest:
        return least, value
    return pair


def _number_at(value: Any, names: Iterable[str]) -> float | None:
    """The number at a path; None if the message has none there that a page can plot."""
    for name in names:
        if isinstance(value, msgspec.Struct):
            if name not in value.__struct_fields__:
                return None
            value = getattr(value, name)
        elif isinstance(value, Sequence) and not isinstance(value, str | bytes | bytearray | memoryview):
            if not (name.isdecimal() and len(name) <= _MOST_DIGITS and int(name) < len(value)):
                return None
            value = value[int(name)]
        else:
            return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return value if isfinite(value) and -_EXACT < value < _EXACT else None
