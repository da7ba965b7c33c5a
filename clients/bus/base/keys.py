"""Keys of a terminal: bytes in, meanings of keys out."""

from collections.abc import Mapping
from typing import Generic, TypeVar

__all__ = ["Keys"]

K = TypeVar("K")
_ESCAPE = b"\x1b"


class Keys(Generic[K]):
    """Decodes bytes as they come; a cursor key has three bytes, which may come one by one.

    `letters` and `cursor` keys (A up, B down, C right, D left) have meanings; others have none.
    """

    def __init__(self, letters: Mapping[bytes, K], cursor: Mapping[bytes, K]) -> None:
        self._letters = letters
        self._cursor = cursor
        self._begun = b""

    def feed(self, data: bytes) -> list[K]:
        """The meanings of the keys that are complete now."""
        found: list[K] = []
        for number in data:
            byte = bytes((number,))
            if byte == _ESCAPE:
                self._begun = byte
            elif self._begun == _ESCAPE and byte in (b"[", b"O"):
                self._begun += byte
            else:
                table = self._cursor if len(self._begun) == 2 else self._letters
                self._begun = b""
                if (key := table.get(byte)) is not None:
                    found.append(key)
        return found
