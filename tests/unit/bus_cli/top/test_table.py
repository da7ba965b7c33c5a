"""Rows as lines: their order, and their fit into a terminal."""

from typing import NamedTuple

from bus_cli.top.table import Column, Line, Table
from rows import for_each


class Cat(NamedTuple):
    name: str
    legs: int
    colour: str = "grey"


CATS = [Cat("Tom", 4), Cat("Butch", 3, "black"), Cat("Ann-Katrin Wilhelmina", 4, "white")]
TABLE = Table(
    [
        Column("NAME", lambda cat: cat.name, lambda cat: cat.name),
        Column("LEGS", lambda cat: str(cat.legs), lambda cat: cat.legs, 4, 2),
        Column("COLOUR", lambda cat: cat.colour, None, 6, 1, is_left=True),
    ],
    lambda cat: "short" if cat.legs < 4 else "",
)


def test_as_wide_as_it_would_be() -> None:
    title, lines = TABLE.lines(CATS, None, by="legs")
    assert title == "NAME                  [LEGS] COLOUR".replace("[LEGS]", "[LE…")
    assert [*lines] == [
        Line("Tom                      4 grey"),
        Line("Butch                    3 black", "short"),
        Line("Ann-Katrin Wilhelmina    4 white"),
    ]
    assert lines[1:] == [*lines][1:]


@for_each(
    ("width", "first"),
    [
        (33, "Ann-Katrin Wilhelmina    4 white"),
        (30, "Ann-Katrin Wilhel…    4 white"),
        (21, "Ann-Katrin Wilh…    4"),
        (16, "Ann-Katrin Wilh…"),
        (6, "Ann-K…"),
        (2, "Ann…"),
    ],
)
def test_what_says_least_goes_first(width: int, first: str) -> None:
    _, lines = TABLE.lines(CATS[2:], width)
    assert lines[0].text == first


@for_each(
    ("by", "names"),
    [("name", "ABT"), ("legs", "ATB"), ("colour", "ABT"), ("nonsense", "ABT")],
)
def test_numbers_from_the_highest_and_texts_from_a(by: str, names: str) -> None:
    assert "".join(cat.name[0] for cat in TABLE.sort(CATS, by)) == names
    assert TABLE.sort_keys == ["name", "legs"]
    assert [cat.legs for cat in TABLE.sort(CATS, "legs", reverse=True)] == [3, 4, 4]
