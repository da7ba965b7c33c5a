"""turtlesim's window, drawn with tkinter."""

from math import cos, sin
from typing import Any

from bus_turtlesim.canvas import SIDE_PX, Colour
from bus_turtlesim.world import Turtle, World

__all__ = ["NoWindow", "Window"]

_LINES_PX = 45.0
_SHAPE = ((1.0, 0.0), (0.55, 0.5), (-0.45, 0.5), (-0.8, 0.0), (-0.45, -0.5), (0.55, -0.5))
"""Outline of a turtle that looks along the first axis, in half metres."""
_COLOURS = ("#3c8c3c", "#8c6a3c", "#8c3c6a", "#3c6a8c", "#c0a030")


class NoWindow(Exception):
    """There can be none here; the text says why."""


class Window:
    """A window of 500 by 500 pixels. Raises NoWindow where there is no display or no tkinter."""

    def __init__(self) -> None:
        try:
            import tkinter
        except ImportError:
            raise NoWindow("this Python has no tkinter") from None
        try:
            self._root: Any = tkinter.Tk()
        except tkinter.TclError as error:
            raise NoWindow(str(error)) from None
        self.is_closed = False
        self._root.title("TurtleSim")
        self._root.resizable(False, False)
        self._root.protocol("WM_DELETE_WINDOW", self._close)
        self._area: Any = tkinter.Canvas(self._root, width=SIDE_PX, height=SIDE_PX, highlightthickness=0)
        self._area.pack()
        self._image: Any = tkinter.PhotoImage(width=SIDE_PX, height=SIDE_PX)
        self._area.create_image(0, 0, anchor="nw", image=self._image)
        self._clearings = 0

    def show(self, world: World, background: Colour) -> None:
        """Draw what is new, and hear of what its user did."""
        if world.canvas.news is None:
            world.canvas.news = []
        if world.canvas.clearings != self._clearings:
            self._clearings = world.canvas.clearings
            self._image.blank()
        for left, top, right, bottom, colour in world.canvas.news:
            self._image.put(_text(colour), to=(left, top, right, bottom))
        world.canvas.news.clear()
        self._area.configure(background=_text(background))
        self._area.delete("turtle")
        for index, turtle in enumerate(world.turtles.values()):
            self._area.create_polygon(
                *outline(turtle), fill=_COLOURS[index % len(_COLOURS)], outline="#202020", tags="turtle"
            )
        self._root.update()

    def _close(self) -> None:
        self.is_closed = True


def outline(turtle: Turtle) -> list[float]:
    """Pixels, from the upper left: x, y, x, y and so on."""
    c, s = cos(turtle.theta), sin(turtle.theta)
    found: list[float] = []
    for along, across in _SHAPE:
        x = turtle.x + (along * c - across * s) / 2
        y = turtle.y + (along * s + across * c) / 2
        found += (x * _LINES_PX, SIDE_PX - 1 - y * _LINES_PX)
    return found


def _text(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
