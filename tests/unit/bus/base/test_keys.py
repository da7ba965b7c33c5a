"""Keys of a terminal."""

from bus.base.keys import Keys


def keys() -> Keys[str]:
    return Keys({b" ": "space", b"A": "letter A"}, {b"A": "up", b"C": "right"})


def test_letters_and_cursor_keys() -> None:
    assert keys().feed(b"x A\x1b[A\x1b[B\x1bOC\x1bxA\xff") == ["space", "letter A", "up", "right", "letter A"]


def test_a_key_may_come_in_pieces() -> None:
    feed = keys().feed
    pieces = (b"\x1b", b"[", b"C", b"A", b"\x1b\x1b[", b"A")
    assert [feed(piece) for piece in pieces] == [[], [], ["right"], ["letter A"], [], ["up"]]
