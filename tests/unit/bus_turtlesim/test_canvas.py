"""The drawings of pens, pixel by pixel."""

import pytest

from bus_turtlesim.canvas import SIDE_PX, Canvas, Pen

RED = (255, 0, 0)


def painted(canvas: Canvas) -> set[tuple[int, int]]:
    return {(x, y) for x in range(SIDE_PX) for y in range(SIDE_PX) if canvas.at(x, y) is not None}


def test_a_line_is_as_wide_as_its_pen() -> None:
    canvas = Canvas()
    canvas.line((10, 10), (12, 10), Pen(RED, 3))
    assert painted(canvas) == {(x, y) for x in range(9, 14) for y in range(9, 12)}
    assert canvas.at(10, 10) == RED


def test_it_goes_over_what_was_there() -> None:
    canvas = Canvas()
    canvas.line((10, 10), (12, 10), Pen(RED, 1))
    canvas.line((11, 5), (11, 15), Pen((0, 0, 9), 1))
    assert [canvas.at(x, 10) for x in (10, 11, 12)] == [RED, (0, 0, 9), RED]


@pytest.mark.parametrize("far", [600.0, 1e30])
def test_what_is_outside_is_not_drawn(far: float) -> None:
    canvas = Canvas()
    canvas.line((490, 490), (far, 490), Pen(RED, 1))
    assert painted(canvas) == {(x, 490) for x in range(490, SIDE_PX)}
    canvas.clear()
    canvas.line((-far, -5), (far, -5), Pen(RED, 1))
    canvas.line((501, 5), (far, 5), Pen(RED, 1))
    assert painted(canvas) == set()
    assert canvas.at(-1, 0) is None


def test_a_window_hears_of_what_is_new() -> None:
    canvas = Canvas()
    canvas.line((1, 1), (1, 1), Pen(RED, 1))
    canvas.news = []
    canvas.line((0, 1), (0, 1), Pen(RED, 3))
    assert set(canvas.news) == {(0, 0, 2, 3, RED)}
    canvas.clear()
    assert (canvas.news, canvas.clearings) == ([], 1)
