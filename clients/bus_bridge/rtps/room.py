"""Memory that samples may take before they are delivered: out of order, or in fragments. Pure."""

from typing import Final

__all__ = ["ITEM_BYTES", "Room"]

ITEM_BYTES: Final = 200
"""The cost of a kept item in addition to its bytes: so many empty items have a limit, too."""


class Room:
    """A number of bytes, shared by the samples of one far participant."""

    __slots__ = ("_left",)

    def __init__(self, size: int) -> None:
        self._left = size

    @property
    def left(self) -> int:
        return self._left

    def take(self, size: int) -> bool:
        """Reserve memory for an item of that size; returns whether there was room."""
        cost = size + ITEM_BYTES
        if cost > self._left:
            return False
        self._left -= cost
        return True

    def give_back(self, size: int, items: int = 1) -> None:
        """Return the memory of `items` items with `size` bytes together."""
        self._left += size + items * ITEM_BYTES
