"""What keys mean to a player: bytes of a terminal in, keys out. Pure."""

from enum import Enum

__all__ = ["Key", "Keys"]


class Key(Enum):
    """Those that mean something, by their names in ROS 2's texts."""

    SPACE = "Pause/Resume"
    CURSOR_RIGHT = "Play Next Message"
    CURSOR_UP = "Increase Rate 10%"
    CURSOR_DOWN = "Decrease Rate 10%"


_CURSOR = {b"A": Key.CURSOR_UP, b"B": Key.CURSOR_DOWN, b"C": Key.CURSOR_RIGHT}
_ESCAPE = b"\x1b"


class Keys:
    """Takes bytes as they come; a cursor key is three of them, which may come one by one."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[Key]:
        """The keys that are whole now; those without a meaning are left out."""
        found: list[Key] = []
        for number in data:
            byte = bytes((number,))
            if byte == _ESCAPE:
                self._begun = byte
            elif self._begun == _ESCAPE and byte in b"[O":
                self._begun += byte
            else:
                key = _CURSOR.get(byte) if len(self._begun) == 2 else Key.SPACE if byte == b" " else None
                self._begun = b""
                if key is not None:
                    found.append(key)
        return found
