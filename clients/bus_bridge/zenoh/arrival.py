"""Parts that arrive from one far publisher: puts them in order, without duplicates, and counts the taken
ones. Pure.

A route first asks for the number of its first part and for the parts that the far side keeps. Parts that
arrive meanwhile are held. The route also asks if a part arrives and an earlier part is missing.
"""

from collections import deque
from itertools import islice

from bus_bridge.zenoh.records import Content, Probe, Room

__all__ = ["HELD_BYTES", "Arrival", "Untaken"]

HELD_BYTES = 16 << 20
"""The most that may wait for missing parts: more than is ever on its way."""
_PART = 256  # cost of a part in bytes, besides its payload


class Arrival:
    """The parts of one far publisher. Waiting parts also use `room`, which all routes in share."""

    def __init__(self, room: Room) -> None:
        self._room = room
        self.last = 0
        """Number of the last part that was passed on."""
        self.is_begun = False
        """Whether the number of the route's first part is known."""
        self._held: dict[int, tuple[Content, int]] = {}
        self._held_bytes = 0
        self._newest = 0

    @property
    def misses(self) -> bool:
        """Whether the far side has to be asked for the part after `last`."""
        return self.is_begun and self._newest > self.last

    def missing(self, most: int) -> list[int]:
        """The first numbers, at most `most`, for which to ask the far side."""
        if not self.misses:
            return []
        numbers = range(self.last + 1, self._newest + 1)
        return list(islice((one for one in numbers if one not in self._held), most))

    def begin(self, base: int) -> list[Content]:
        """Start after the part `base`; returns the parts to pass on."""
        self.is_begun, self.last = True, base
        for number in [one for one in self._held if one <= base]:
            self._release(number)
        return self._flush()

    def arrive(self, number: int, content: Content, size: int) -> list[Content]:
        """Handle a part of `size` bytes; returns the parts to pass on."""
        if isinstance(content, Probe):
            self._newest = max(self._newest, number)
            return []
        if self.is_begun:
            if number <= self.last:  # a duplicate
                return []
            if number == self.last + 1:
                self.last = number
                self._newest = max(self._newest, number)
                return [content, *self._flush()] if self._held else [content]
        self._newest = max(self._newest, number)
        size += _PART
        if number in self._held or self._held_bytes + size > HELD_BYTES:
            return []  # it will be asked for again
        if self._room.take(size):
            self._held[number] = content, size
            self._held_bytes += size
        return []

    def skip_to(self, number: int) -> list[Content]:
        """Skip missing parts before `number` that the far side no longer keeps; returns the parts to pass
        on."""
        self.last = max(self.last, min((number, *self._held)) - 1)
        return self._flush()

    def skip(self, upto: int) -> list[Content]:
        """Skip all missing parts, because the far side keeps none; returns the parts to pass on.

        `upto`: the newest part, as the far side has answered. A higher number came from another program.
        """
        gone = self.skip_to(min(self._newest, upto) + 1)
        self._newest = max(self.last, upto)
        return gone

    def _flush(self) -> list[Content]:
        gone = list[Content]()
        while self.last + 1 in self._held:
            self.last += 1
            gone.append(self._release(self.last))
        return gone

    def clear(self) -> None:
        """Drop the waiting parts."""
        for number in tuple(self._held):
            self._release(number)

    def _release(self, number: int) -> Content:
        content, size = self._held.pop(number)
        self._held_bytes -= size
        self._room.give(size)
        return content


class Untaken:
    """Parts of a lossless publisher until this bus has taken their messages. The bus reports only numbers of
    bytes."""

    def __init__(self) -> None:
        self._parts: deque[tuple[int, int]] = deque()
        self._credit = 0
        self._last = 0

    def __len__(self) -> int:
        return len(self._parts)

    def add(self, number: int, size: int) -> None:
        """Add the next part; its messages have `size` bytes."""
        if self._parts and not size:  # otherwise empty parts of a far side could fill the memory
            size = self._parts.pop()[1]
        self._parts.append((number, size))

    def take(self, size: int) -> None:
        """Handle `size` more taken bytes."""
        self._credit += size

    def last_taken(self) -> int:
        """The number of the newest part that was taken as a whole."""
        parts = self._parts
        while parts and parts[0][1] <= self._credit:
            self._last, size = parts.popleft()
            self._credit -= size
        return self._last
