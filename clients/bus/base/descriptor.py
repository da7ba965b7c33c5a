"""A file descriptor that belongs to one object, and is closed with it."""

import os


class Descriptor:
    """Owns the descriptor `number`. Closed by `close`, or with the last reference to the object."""

    __slots__ = ("__weakref__", "number")

    def __init__(self, number: int) -> None:
        self.number = number

    def fileno(self) -> int:
        """The number; -1 after the close."""
        return self.number

    def close(self) -> None:
        """Close the descriptor; closing twice is allowed."""
        number, self.number = self.number, -1
        if number >= 0:
            os.close(number)

    def __del__(self) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Descriptor({self.number})"
