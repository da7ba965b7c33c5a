"""The lines that the turtles' pens draw, as pixels. Must not know pages and terminals."""

from typing import NamedTuple

__all__ = ["SIDE_PX", "Canvas", "Colour", "Pen", "Square"]

SIDE_PX = 500
_BYTES = 4

Colour = tuple[int, int, int]
"""Red, green and blue, each from 0 to 255."""
Square = tuple[int, int, int, int, Colour]
"""Left, top, right and bottom, the last two exclusive, in pixels from the upper left; and its colour."""


class Pen(NamedTuple):
    """How a turtle draws. `width` is in pixels."""

    colour: Colour = (0xB3, 0xB8, 0xFF)
    width: int = 3
    is_on: bool = True


class Canvas:
    """Pixels, each of a colour or clear.

    If `news` is a list, it gets everything painted from then on, for a page to take out.
    """

    def __init__(self) -> None:
        self._pixels = bytearray(SIDE_PX * SIDE_PX * _BYTES)
        self.news: list[Square] | None = None
        self.clearings = 0

    def clear(self) -> None:
        self._pixels = bytearray(len(self._pixels))
        self.clearings += 1
        if self.news is not None:
            self.news.clear()

    def picture(self) -> bytes:
        """All pixels from the upper left, line by line: red, green, blue; and 255 where painted, else 0."""
        pixels = bytearray(self._pixels)  # in one step, for another thread may ask
        pixels[_BYTES - 1 :: _BYTES] = pixels[_BYTES - 1 :: _BYTES].replace(b"\1", b"\xff")
        return bytes(pixels)

    def at(self, x: int, y: int) -> Colour | None:
        """The colour of a pixel; None: it is clear, or there is none."""
        if not (0 <= x < SIDE_PX and 0 <= y < SIDE_PX):
            return None
        start = (y * SIDE_PX + x) * _BYTES
        red, green, blue, is_painted = self._pixels[start : start + _BYTES]
        return (red, green, blue) if is_painted else None

    def line(self, start: tuple[float, float], end: tuple[float, float], pen: Pen) -> None:
        """Draw from one point to another, both in pixels; outside of the canvas nothing is drawn."""
        inside = _clipped(start, end, pen.width)
        if inside is None:
            return
        (x, y), (end_x, end_y) = inside
        steps = max(1, round(max(abs(end_x - x), abs(end_y - y))))
        for step in range(steps + 1):
            part = step / steps
            self._spot(round(x + (end_x - x) * part), round(y + (end_y - y) * part), pen)

    def _spot(self, x: int, y: int, pen: Pen) -> None:
        left, top = max(0, x - pen.width // 2), max(0, y - pen.width // 2)
        right = min(SIDE_PX, x - pen.width // 2 + pen.width)
        bottom = min(SIDE_PX, y - pen.width // 2 + pen.width)
        if left >= right or top >= bottom:
            return
        row = bytes((*pen.colour, 1)) * (right - left)
        for line in range(top, bottom):
            start = (line * SIDE_PX + left) * _BYTES
            self._pixels[start : start + len(row)] = row
        if self.news is not None:
            self.news.append((left, top, right, bottom, pen.colour))


def _clipped(
    start: tuple[float, float], end: tuple[float, float], margin: int
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The part of a line that can be visible: a far end costs nothing. None: no part."""
    first, last = 0.0, 1.0
    for begin, stop in zip(start, end, strict=True):
        way = stop - begin
        low, high = -margin - begin, SIDE_PX + margin - begin
        if way == 0:
            if low > 0 or high < 0:
                return None
            continue
        near, far = sorted((low / way, high / way))
        first, last = max(first, near), min(last, far)
    if first > last:
        return None
    (x, y), (way_x, way_y) = start, (end[0] - start[0], end[1] - start[1])
    return (x + way_x * first, y + way_y * first), (x + way_x * last, y + way_y * last)
