"""The meaning of keys to a player. Pure."""

from enum import Enum

__all__ = ["CURSOR", "LETTERS", "Key"]


class Key(Enum):
    """Keys with a meaning, by their names in ROS 2's texts."""

    SPACE = "Pause/Resume"
    CURSOR_RIGHT = "Play Next Message"
    CURSOR_UP = "Increase Rate 10%"
    CURSOR_DOWN = "Decrease Rate 10%"


LETTERS = {b" ": Key.SPACE}
CURSOR = {b"A": Key.CURSOR_UP, b"B": Key.CURSOR_DOWN, b"C": Key.CURSOR_RIGHT}
