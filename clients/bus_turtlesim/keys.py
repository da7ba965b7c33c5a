"""The meaning of keys for a turtle: velocities and headings. Pure."""

from typing import NamedTuple

__all__ = ["ARROWS", "CANCEL", "LETTERS", "QUIT", "Heading", "Key", "Move"]


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

ARROWS: dict[bytes, Key] = {
    b"A": Move(1.0, 0.0),
    b"B": Move(-1.0, 0.0),
    b"C": Move(0.0, -1.0),
    b"D": Move(0.0, 1.0),
}
_LOWER: dict[bytes, Key] = {
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
LETTERS = _LOWER | {letter.upper(): key for letter, key in _LOWER.items()}
