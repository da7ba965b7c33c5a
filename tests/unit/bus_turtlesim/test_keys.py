"""The effect of each key."""

from bus.base.keys import Keys
from bus_turtlesim.keys import ARROWS, CANCEL, LETTERS, QUIT, Heading, Key, Move


def pressed(data: bytes) -> list[Key]:
    return Keys(LETTERS, ARROWS).feed(data)


def test_arrows_move() -> None:
    assert pressed(b"\x1b[A\x1b[B\x1b[C\x1bOD") == [Move(1, 0), Move(-1, 0), Move(0, -1), Move(0, 1)]


def test_letters_around_f() -> None:
    names = "gtredcvb"
    headings = [0.0, 0.7854, 1.5708, 2.3562, 3.1416, -2.3562, -1.5708, -0.7854]
    assert pressed((names + names.upper()).encode()) == [Heading(theta) for theta in headings] * 2
    assert pressed(b"fQ") == [CANCEL, QUIT]


def test_others_mean_nothing() -> None:
    assert pressed(b"xyz \n\xff\x1b[Z\x1bxg") == [Heading(0.0)]
