"""Turtles, and how they move: no bus, no clock, no window.

`World` has the turtles by name; its shell calls `Turtle.step` every 16 ms and says when it is.
"""

from math import cos, floor, hypot, isfinite, pi, sin
from typing import NamedTuple

from bus_turtlesim.canvas import Canvas, Colour, Pen

__all__ = ["PERIOD_S", "SIZE", "Rotation", "Step", "Turtle", "World", "are_finite"]

PERIOD_S = 0.016
SIZE = 11.088889122009277
"""Width and height in metres: 499 pixels, a float of 32 bits as in ROS 2."""
_METRE_PX = 45.0
_COMMAND_NS = 1_000_000_000
"""How long a velocity is valid."""
_NEAR = 0.02
_MOST_TURTLES = 100


class Rotation(NamedTuple):
    """How a turn to an absolute heading goes: angles in rad."""

    remaining: float
    delta: float
    is_done: bool


class Step(NamedTuple):
    """The result of a turtle's step.

    `wall`: the position that the turtle would have without a wall, y downward as in the window.
    `rotation`: None if the turtle turns to no heading.
    """

    wall: tuple[float, float] | None
    rotation: Rotation | None


class Turtle:
    """One turtle: x and y from the lower left in m, the heading `theta` in rad."""

    def __init__(self, x: float, y: float, theta: float, canvas: Canvas, now_ns: int) -> None:
        self.x, self.y, self.theta = x, y, theta
        self.pen = Pen()
        self.velocity = (0.0, 0.0, 0.0)
        """Forward and to the left in m/s, and the turn in rad/s."""
        self._canvas = canvas
        self._commanded_ns = now_ns
        self._heading: float | None = None
        self._start = 0.0
        self._turned = 0.0

    @property
    def speed(self) -> float:
        return hypot(*self.velocity[:2])

    @property
    def delta(self) -> float:
        """The angle turned on the way to a heading, as of the last step: the start heading minus the
        present one.
        """
        return self._turned

    def command(self, forward: float, left: float, turn: float, now_ns: int) -> None:
        """Move so for a second; a turn to a heading ends."""
        self.velocity = (forward, left, turn)
        self._commanded_ns = now_ns
        self._heading = None

    def rotate(self, theta: float) -> None:
        """Turn to this heading from the next step on."""
        self._heading, self._start, self._turned = _normal(theta), self.theta, 0.0

    def halt(self) -> None:
        """Stand still, and turn to no heading."""
        self.velocity, self._heading = (0.0, 0.0, 0.0), None

    def teleport(self, x: float, y: float, theta: float) -> None:
        """Be there at once; the next step finds it within the walls."""
        before = self._place()
        self.x, self.y, self.theta = x, min(y, SIZE), theta
        self._draw(before)

    def jump(self, linear: float, angular: float) -> None:
        """Turn by an angle, then go so far, at once."""
        before = self._place()
        self.theta += angular
        self.x += cos(self.theta) * linear
        self.y += sin(self.theta) * linear
        self._draw(before)

    def step(self, now_ns: int) -> Step:
        """Move for 16 ms."""
        rotation = self._steer(now_ns)
        if now_ns - self._commanded_ns > _COMMAND_NS:
            self.velocity = (0.0, 0.0, 0.0)
        forward, left, turn = self.velocity
        before = self._place()
        self.theta = _normal(self.theta + turn * PERIOD_S)
        x = self.x + (cos(self.theta) * forward - sin(self.theta) * left) * PERIOD_S
        y = self.y + (sin(self.theta) * forward + cos(self.theta) * left) * PERIOD_S
        self.x, self.y = min(max(x, 0.0), SIZE), min(max(y, 0.0), SIZE)
        if self._place() != before:
            self._draw(before)
        return Step((x, SIZE - y) if (self.x, self.y) != (x, y) else None, rotation)

    def colour(self) -> Colour | None:
        """The colour drawn under the turtle; None if nothing is drawn there."""
        x, y = self._place()
        return self._canvas.at(round(x), round(y))

    def _steer(self, now_ns: int) -> Rotation | None:
        if self._heading is None:
            return None
        remaining = _normal(self._heading - self.theta)
        self._turned = _normal(self._start - self.theta)
        is_done = abs(remaining) < _NEAR
        if is_done:
            self.halt()
        else:
            self.velocity = (0.0, 0.0, -1.0 if remaining < 0 else 1.0)
            self._commanded_ns = now_ns
        return Rotation(remaining, self._turned, is_done)

    def _place(self) -> tuple[float, float]:
        """In pixels, from the upper left."""
        return self.x * _METRE_PX, (SIZE - self.y) * _METRE_PX

    def _draw(self, start: tuple[float, float]) -> None:
        if self.pen.is_on:
            self._canvas.line(start, self._place(), self.pen)


class World:
    """The turtles by name, and their canvas."""

    def __init__(self) -> None:
        self.turtles: dict[str, Turtle] = {}
        self.canvas = Canvas()
        self._last_number = 0

    def spawn(self, x: float, y: float, theta: float, now_ns: int, name: str = "") -> str:
        """Add a turtle and return its name; turtle1, turtle2 and so on if none is given.

        Raises ValueError, with a text for its user, if the name is taken, if a number is infinite or no
        number, or if there are 100 turtles.
        """
        if not are_finite(x, y, theta):
            raise ValueError(f"Can't spawn a turtle at x=[{x}], y=[{y}], theta=[{theta}]")
        if name in self.turtles:
            raise ValueError(f"A turtle named [{name}] already exists")
        if len(self.turtles) >= _MOST_TURTLES:
            raise ValueError(f"There are {_MOST_TURTLES} turtles already, the most that fit")
        while not name:
            self._last_number += 1
            numbered = f"turtle{self._last_number}"
            name = numbered if numbered not in self.turtles else ""
        self.turtles[name] = Turtle(x, y, theta, self.canvas, now_ns)
        return name

    def kill(self, name: str) -> None:
        """Take a turtle away. Raises ValueError, with a text for its user, if there is none."""
        if self.turtles.pop(name, None) is None:
            raise ValueError(f"Tried to kill turtle [{name}], which does not exist")

    def reset(self) -> None:
        """Remove all turtles and drawings; numbers start again at 1."""
        self.turtles.clear()
        self.canvas.clear()
        self._last_number = 0


def are_finite(*numbers: float) -> bool:
    """Whether a turtle can use these numbers."""
    return all(map(isfinite, numbers))


def _normal(angle: float) -> float:
    """The same angle from -pi to pi."""
    return angle - 2 * pi * floor((angle + pi) / (2 * pi))
