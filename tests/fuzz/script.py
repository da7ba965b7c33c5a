"""An input as a script: each byte chooses a next step, so a changed byte is a changed step.

After its end, each choice is the first, the least, or the empty one.
"""

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")

_EDGES = (0, 1, 1 << 31, 1 << 32, (1 << 62) - 1, 1 << 62, 1 << 63, (1 << 64) - 1)


class Script:
    """Reads `data` from its start."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def __bool__(self) -> bool:
        """Whether there is more."""
        return self._at < len(self._data)

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1] if self._at <= len(self._data) else 0

    def choose(self, choices: Sequence[T]) -> T:
        return choices[self.byte() % len(choices)]

    def number(self, near: int = 0, *, signed: bool = True) -> int:
        """A number that fits into 64 bits: mostly one near `near`, rarely one at a limit."""
        byte = self.byte()
        if byte < 128:
            number = near + byte
        elif byte < 176:
            number = near - (byte - 128)
        elif byte < 208:
            number = _EDGES[byte % len(_EDGES)]
        elif byte < 232:
            number = self.byte() << (byte - 208)
        else:
            number = _EDGES[byte % len(_EDGES)] - self.byte()
        least = -(1 << 63) if signed else 0
        return min(max(number, least), (1 << 64) - 1)

    def take(self, count: int) -> bytes:
        """The next `count` bytes, or as many as are left."""
        taken = self._data[self._at : self._at + count]
        self._at += count
        return taken

    def rest(self) -> bytes:
        return self.take(len(self._data))
