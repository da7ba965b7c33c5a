"""Errors of bags, with texts for the user."""

from bus.errors import BusError

__all__ = ["BagError", "BagFull"]


class BagError(BusError):
    """A bag can't be read, written or understood. The text names the file and the fault."""


class BagFull(BagError):
    """The disk or the file is full. The part written before is kept, and the bag can be closed."""

    def __init__(self, message: str, *, room: int = 0, is_limit: bool = False) -> None:
        super().__init__(message)
        self.room = room
        """Number of bytes that were still free."""
        self.is_limit = is_limit
        """Whether the limit is the file's size, not the disk."""
