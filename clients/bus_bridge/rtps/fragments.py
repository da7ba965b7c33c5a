"""A sample that arrives in fragments. Pure.

A false total costs no memory: only fragments that have arrived do.
"""

from bus_bridge.rtps.messages import MOST_IN_SET, DataFragments
from bus_bridge.rtps.parameters import Order, Parameters
from bus_bridge.rtps.room import Room

__all__ = ["Partial"]


class Partial:
    """Fragments of one sample. The first ones set its total size and the size of a fragment."""

    __slots__ = (
        "_bytes",
        "_fragment_bytes",
        "_fragments",
        "_lowest",
        "_pieces",
        "_room",
        "_total",
        "inline",
        "order",
        "time_ns",
        "touched_ns",
    )

    def __init__(self, one: DataFragments, time_ns: int, room: Room) -> None:
        self.inline: Parameters = one.inline
        self.order: Order = one.order
        self.time_ns = time_ns
        self.touched_ns = 0
        """When the last new fragment came."""
        self._room = room
        self._total, self._fragment_bytes = one.total_bytes, one.fragment_bytes
        self._fragments = -(-one.total_bytes // one.fragment_bytes)
        self._pieces: dict[int, bytes] = {}
        self._bytes = 0
        self._lowest = 1
        """All fragments below this one are there."""

    @property
    def is_whole(self) -> bool:
        return len(self._pieces) == self._fragments

    def add(self, one: DataFragments, now_ns: int) -> bool:
        """Add fragments that fit to those before; returns whether there was room for them."""
        if (one.total_bytes, one.fragment_bytes) != (self._total, self._fragment_bytes):
            return True  # of another sample: a writer in order sends no such thing
        size = one.fragment_bytes
        for offset in range(one.amount):
            number = one.first + offset
            if number in self._pieces:
                continue
            piece = one.payload[offset * size : (offset + 1) * size]
            if not self._room.take(len(piece)):
                return False
            self._pieces[number] = piece
            self._bytes += len(piece)
            self.touched_ns = now_ns
        return True

    def missing(self) -> list[int]:
        """The next missing fragments, as many as one NACK_FRAG can name."""
        while self._lowest in self._pieces:
            self._lowest += 1
        end = min(self._lowest + MOST_IN_SET, self._fragments + 1)
        return [number for number in range(self._lowest, end) if number not in self._pieces]

    def join(self) -> bytes:
        """The whole sample, once it is there; its memory is given back."""
        whole = b"".join([self._pieces[number] for number in range(1, self._fragments + 1)])
        self.discard()
        return whole

    def discard(self) -> None:
        """Give the memory back."""
        self._room.give_back(self._bytes, len(self._pieces))
        self._pieces.clear()
        self._bytes = 0
