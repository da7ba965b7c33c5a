"""Parts that have arrived from one far publisher: in order, each once; and how much of it was taken. Pure.

A route first asks for the number of its first part and for the parts that the far side keeps. Parts that
arrive meanwhile are held. It asks again whenever a part is missing before one that has come.
"""

from collections import deque
from itertools import islice

from bus_bridge.zenoh.records import Content, Probe, Room

__all__ = ["HELD_BYTES", "Arrival", "Untaken"]

HELD_BYTES = 16 << 20
"""That may wait for what is missing: more than is ever under way."""
_PART = 256  # bytes that one costs besides its payload


class Arrival:
    """Waiting parts also take of `room`, which all ways in share."""

    def __init__(self, room: Room) -> None:
        self._room = room
        self.last = 0
        """Number of the last part that has gone on."""
        self.is_begun = False
        """Whether the number of the route's first part is known."""
        self._held: dict[int, tuple[Content, int]] = {}
        self._held_bytes = 0
        self._newest = 0

    @property
    def misses(self) -> bool:
        """Whether the far side has to be asked for the part behind `last`."""
        return self.is_begun and self._newest > self.last

    def missing(self, most: int) -> list[int]:
        """The numbers, `most` of them, that the far side has to be asked for."""
        if not self.misses:
            return []
        numbers = range(self.last + 1, self._newest + 1)
        return list(islice((one for one in numbers if one not in self._held), most))

    def begin(self, base: int) -> list[Content]:
        """The parts behind `base` are for us. Returns the parts that may go on."""
        self.is_begun, self.last = True, base
        for number in [one for one in self._held if one <= base]:
            self._release(number)
        return self._flush()

    def arrive(self, number: int, content: Content, size: int) -> list[Content]:
        """A part has come, of so many bytes. Returns the parts that may go on."""
        if isinstance(content, Probe):
            self._newest = max(self._newest, number)
            return []
        if self.is_begun:
            if number <= self.last:  # a second time
                return []
            if number == self.last + 1:
                self.last = number
                self._newest = max(self._newest, number)
                return [content, *self._flush()] if self._held else [content]
        self._newest = max(self._newest, number)
        size += _PART
        if number in self._held or self._held_bytes + size > HELD_BYTES:
            return []  # it is asked for
        if self._room.take(size):
            self._held[number] = content, size
            self._held_bytes += size
        return []

    def skip(self) -> list[Content]:
        """The far side no longer keeps the missing parts: go on with those that are here."""
        self.last = min(self._held, default=self._newest + 1) - 1
        return self._flush()

    def _flush(self) -> list[Content]:
        gone = list[Content]()
        while self.last + 1 in self._held:
            self.last += 1
            gone.append(self._release(self.last))
        return gone

    def clear(self) -> None:
        """Drop what waits."""
        for number in tuple(self._held):
            self._release(number)

    def _release(self, number: int) -> Content:
        content, size = self._held.pop(number)
        self._held_bytes -= size
        self._room.give(size)
        return content


class Untaken:
    """Parts of a lossless publisher until this bus has taken their messages, of which it says only how many
    bytes they have."""

    def __init__(self) -> None:
        self._parts: deque[tuple[int, int]] = deque()
        self._credit = 0
        self._last = 0

    def __len__(self) -> int:
        return len(self._parts)

    def add(self, number: int, size: int) -> None:
        """Add the next part, whose messages have so many bytes."""
        if self._parts and not size:  # or a far side that sends nothing but empty ones would fill the memory
            size = self._parts.pop()[1]
        self._parts.append((number, size))

    def take(self, size: int) -> None:
        """So many bytes more were taken."""
        self._credit += size

    def last_taken(self) -> int:
        """The number of the newest part of which all was taken."""
        parts = self._parts
        while parts and parts[0][1] <= self._credit:
            self._last, size = parts.popleft()
            self._credit -= size
        return self._last
