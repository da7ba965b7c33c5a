"""The player's action for each key."""

from bus.base.keys import Keys
from bus_bag.play.keys import CURSOR, LETTERS, Key


def test_keys() -> None:
    pressed = Keys(LETTERS, CURSOR).feed(b"x \x1b[A\x1b[B\x1b[C\x1b[Dq")
    assert pressed == [Key.SPACE, Key.CURSOR_UP, Key.CURSOR_DOWN, Key.CURSOR_RIGHT]
