"""What keys mean to a player."""

from bus_bag.play.keys import Key, Keys


def test_keys() -> None:
    pressed = Keys().feed(b"x \x1b[A\x1b[B\x1b[C\x1b[D\x1bOC q")
    assert pressed == [
        Key.SPACE,
        Key.CURSOR_UP,
        Key.CURSOR_DOWN,
        Key.CURSOR_RIGHT,
        Key.CURSOR_RIGHT,
        Key.SPACE,
    ]


def test_a_key_may_come_in_pieces() -> None:
    keys = Keys()
    assert [keys.feed(piece) for piece in (b"\x1b", b"[", b"C", b"A", b"\x1b\x1b[", b"A")] == [
        *([], [], [Key.CURSOR_RIGHT], [], []),
        [Key.CURSOR_UP],
    ]
