"""What keys mean to a turtle: bytes of a terminal in, velocities and headings out."""

from typing import NamedTuple

__all__ = ["CANCEL", "QUIT", "Heading", "Key", "Keys", "Move"]


class Move(NamedTuple):
    """Forward or back, and left or right: -1, 0 or 1."""

    forward: float
    turn: float


class Heading(NamedTuple):
    """A turn to an absolute heading, in rad."""

    theta: float


CANCEL = "cancel"
QUIT = "quit"
Key = Move | Heading | str

_ARROWS = {b"A": Move(1.0, 0.0), b"B": Move(-1.0, 0.0), b"C": Move(0.0, -1.0), b"D": Move(0.0, 1.0)}
_LETTERS: dict[bytes, Key] = {
    # As they lie around F.
    b"g": Heading(0.0),
    b"t": Heading(0.7854),
    b"r": Heading(1.5708),
    b"e": Heading(2.3562),
    b"d": Heading(3.1416),
    b"c": Heading(-2.3562),
    b"v": Heading(-1.5708),
    b"b": Heading(-0.7854),
    b"f": CANCEL,
    b"q": QUIT,
}
_ESCAPE = b"\x1b"


class Keys:
    """Takes bytes as they come; an arrow is three of them, which may come one by one."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[Key]:
        """The keys that are whole now; those without a meaning are left out."""
        found: list[Key] = []
        for number in data:
            byte = bytes((number,))
            if byte == _ESCAPE:
                self._begun = byte
            elif self._begun == _ESCAPE and byte in (b"[", b"O"):
                self._begun += byte
            else:
                table = _ARROWS if len(self._begun) == 2 else _LETTERS
                key = table.get(byte if table is _ARROWS else byte.lower())
                self._begun = b""
                if key is not None:
                    found.append(key)
        return found
