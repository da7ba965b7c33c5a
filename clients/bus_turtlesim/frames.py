"""Recent drawing, for pages in browsers: each page is sent the frames that it has not had. Pure."""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from bus_turtlesim.canvas import Colour, Square
from bus_turtlesim.world import Turtle

__all__ = ["Frames", "Pictures", "Seen", "message"]

_MOST_FRAMES = 250
"""Four seconds; a page that is later than that is sent the whole picture."""
_MOST_SQUARES = 10_000
"""In all of them: as JSON they are half as long as a picture."""
_PICTURES = 8


class Seen(NamedTuple):
    """A turtle as a page draws it: its place in m from the lower left, its heading in rad."""

    name: str
    x: float
    y: float
    theta: float
    picture: int
    """Which of the eight kinds of turtles it looks like; it keeps that."""


class Frames:
    """The drawing of the last steps. Frames are numbered from 1."""

    def __init__(self) -> None:
        self.newest = 0
        self._frames: deque[tuple[bool, list[Square]]] = deque()
        self._squares = 0

    def add(self, squares: list[Square], *, is_cleared: bool) -> None:
        """Add the drawing of a step; if `is_cleared`, the canvas was cleared before it."""
        self._frames.append((is_cleared, squares))
        self._squares += len(squares)
        self.newest += 1
        while len(self._frames) > _MOST_FRAMES or self._squares > _MOST_SQUARES:
            self._squares -= len(self._frames.popleft()[1])

    def since(self, number: int) -> tuple[bool, list[Square]] | None:
        """All frames after frame `number`, as one; None if that is too long ago."""
        missing = self.newest - number
        if missing > len(self._frames):
            return None
        was_cleared = False
        found: list[Square] = []
        for is_cleared, squares in list(self._frames)[len(self._frames) - missing :]:
            if is_cleared:
                was_cleared, found = True, []
            found += squares
        return was_cleared, found


class Pictures:
    """Which picture each turtle has: the next one, and it stays."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._count = 0

    def update(self, turtles: Iterable[tuple[str, Turtle]]) -> tuple[Seen, ...]:
        """The turtles as they are now."""
        before, self._numbers = self._numbers, {}
        found = []
        for name, turtle in turtles:
            number = before.get(name)
            if number is None:
                number = self._count % _PICTURES
                self._count += 1
            self._numbers[name] = number
            found.append(Seen(name, turtle.x, turtle.y, turtle.theta, number))
        return tuple(found)


def message(
    seen: tuple[Seen, ...], background: Colour, squares: list[Square], *, is_cleared: bool
) -> dict[str, object]:
    """The message for a page."""
    return {
        "turtles": [one._asdict() for one in seen],
        "background": _text(background),
        "cleared": is_cleared,
        "squares": [[*places, _text(colour)] for *places, colour in squares],
    }


def _text(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
