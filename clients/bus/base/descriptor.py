"""A file descriptor that belongs to one object, and is closed with it."""

import os


class Descriptor:
    """Owns `number`. Closed by `close`, or when nothing holds the object any more."""

    __slots__ = ("__weakref__", "number")

    def __init__(self, number: int) -> None:
        self.number = number

    def fileno(self) -> int:
        """The number; -1 once it is closed."""
        return self.number

    def close(self) -> None:
        """Close it; closing twice is allowed."""
        number, self.number = self.number, -1
        if number >= 0:
            os.close(number)

    def __del__(self) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Descriptor({self.number})"
