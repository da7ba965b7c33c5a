"""What keys mean."""

from bus_turtlesim.keys import CANCEL, QUIT, Heading, Keys, Move


def test_arrows_move() -> None:
    assert Keys().feed(b"\x1b[A\x1b[B\x1b[C\x1bOD") == [Move(1, 0), Move(-1, 0), Move(0, -1), Move(0, 1)]


def test_an_arrow_in_parts() -> None:
    keys = Keys()
    assert [key for part in (b"\x1b", b"[", b"A") for key in keys.feed(part)] == [Move(1, 0)]


def test_letters_around_f() -> None:
    names = "gtredcvb"
    found = Keys().feed((names + names.upper()).encode())
    headings = [0.0, 0.7854, 1.5708, 2.3562, 3.1416, -2.3562, -1.5708, -0.7854]
    assert found == [Heading(theta) for theta in headings] * 2
    assert Keys().feed(b"fQ") == [CANCEL, QUIT]


def test_others_mean_nothing() -> None:
    keys = Keys()
    assert keys.feed(b"xyz \n\xff\x1b[Z\x1bx") == []
    assert keys.feed(b"g") == [Heading(0.0)]
