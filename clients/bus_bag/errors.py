"""Errors of bags. Their texts are for the user."""

from bus.errors import BusError

__all__ = ["BagError", "BagFull"]


class BagError(BusError):
    """A bag can't be read, written or understood. The text names the file and what is wrong there."""


class BagFull(BagError):
    """Nothing more fits on the disk, or into the file. The part written before is kept, and the bag can be
    closed."""

    def __init__(self, message: str, *, room: int = 0, is_limit: bool = False) -> None:
        super().__init__(message)
        self.room = room
        """Bytes that would still have fitted."""
        self.is_limit = is_limit
        """Whether it is a limit of the file's size, and not the disk."""
