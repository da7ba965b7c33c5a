"""The range of plotted numbers between two messages that a page shows."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.msg.geometry_msgs import Point, Vector3Stamped
from bus.msg.std_msgs import Bool, Float64, Float64MultiArray, String
from bus_web.extremes import MOST_PLOTTED, Extremes, Range
from rows import for_each


def taken(path: str, *messages: Any) -> Range | None:
    extremes = Extremes([path])
    for at, message in enumerate(messages):
        extremes.add(message, 8, at)
    return extremes.take()


def test_the_extreme_that_came_first_stands_first() -> None:
    assert taken("x", *[Point(x=x) for x in (1.0, 5.0, -2.0, 0.0)]) == Range(0, (("x", 5.0, -2.0),))
    assert taken("x", *[Point(x=x) for x in (1.0, -2.0, 5.0, 0.0)]) == Range(0, (("x", -2.0, 5.0),))


def test_one_message_has_no_range() -> None:
    assert taken("x", Point(x=1.0)) is None
    assert taken("x") is None


def test_each_range_begins_anew() -> None:
    extremes = Extremes(["x"])
    for first in (0.0, 10.0):
        for at in range(3):
            extremes.add(Point(x=first + at), 8, int(first) + at)
        assert extremes.take() == Range(int(first), (("x", first, first + 2),))


def test_several_numbers_each_in_their_own_order() -> None:
    extremes = Extremes(["vector.x", "vector.y", "header.stamp.sec", "nowhere.at_all"])
    for at, (x, y) in enumerate(((0.0, 0.0), (1.0, -1.0), (-1.0, 1.0))):
        message = Vector3Stamped()
        message.vector.x, message.vector.y, message.header.stamp.sec = x, y, at
        extremes.add(message, 8, 7)
    found = extremes.take()
    assert found is not None
    assert {path: pair for path, *pair in found.ends} == {
        "vector.x": [1.0, -1.0],
        "vector.y": [-1.0, 1.0],
        "header.stamp.sec": [0, 2],
    }


@for_each(
    ("path", "message"),
    [
        ("data", String(data="5")),
        ("data", Bool(data=True)),
        ("data", Float64(data=float("nan"))),
        ("data", Float64(data=float("inf"))),
        ("data", Float64(data=2.0**53)),
        ("data.0", String(data="5")),
        ("data", Float64MultiArray(data=[1.0])),
        ("data.1", Float64MultiArray(data=[1.0])),
        ("data.-1", Float64MultiArray(data=[1.0])),
        ("data.²", Float64MultiArray(data=[1.0])),
        ("data." + "0" * 5000, Float64MultiArray(data=[1.0])),
        ("__class__", Float64(data=1.0)),
        ("__struct_fields__.0", Float64(data=1.0)),
        ("", Float64(data=1.0)),
    ],
)
def test_other_values_are_no_numbers_of_a_plot(path: str, message: Any) -> None:
    assert taken(path, message, message) is None


def test_an_element_of_an_array() -> None:
    arrays = [Float64MultiArray(data=[0.0] * 11 + [x]) for x in (3.0, 4.0)]
    assert taken("data.11", *arrays) == Range(0, (("data.11", 3.0, 4.0),))


def test_the_work_is_bounded() -> None:
    assert not Extremes().has_room(0), "nothing is plotted"
    extremes = Extremes([f"{n}" for n in range(100)])
    assert len(extremes.paths) == MOST_PLOTTED
    assert not extremes.has_room((1 << 20) + 1)
    extremes.add(Point(), 1 << 20, 0)
    assert not extremes.has_room(1)
    extremes.take()
    for at in range(64):
        assert extremes.has_room(100)
        extremes.add(Point(), 100, at)
    assert not extremes.has_room(0)
    extremes.clear()
    assert extremes.has_room(1 << 20)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=50))
def test_they_are_the_least_and_the_greatest(values: list[float]) -> None:
    found = taken("x", *[Point(x=x) for x in values])
    assert found is not None
    [(_, first, second)] = found.ends
    assert {first, second} == {min(values), max(values)}
    assert values.index(first) <= values.index(second)


@pytest.mark.parametrize("numbers", [(0.0, -0.0), (1.0, 1.0)])
def test_equal_values(numbers: tuple[float, float]) -> None:
    assert taken("x", *[Point(x=x) for x in numbers]) == Range(0, (("x", numbers[0], numbers[0]),))
