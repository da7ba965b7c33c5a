"""Several places in the order of time. At equal times, the order of the places decides."""

from collections.abc import Iterator
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from bags import START, Said, read, write_bag
from bus_bag.storage import open_bag
from bus_bag.storage.merge import Place, merge


def place(
    *times: int, name: str = "", begin: int | None = None, opened: list[str] | None = None
) -> Place[str]:
    """A place of things with these times. Each thing is named after its place and its number."""

    def things() -> Iterator[tuple[int, str]]:
        if opened is not None:
            opened.append(name)
        return iter([(time, f"{name}{number}") for number, time in enumerate(times)])

    return Place(times[0] if begin is None else begin, things)


def test_of_equal_times_the_earlier_place_comes_first_also_if_it_begins_later() -> None:
    assert list(merge([place(5, name="a"), place(3, 5, name="b")])) == ["b0", "a0", "b1"]
    assert list(merge([place(3, 5, name="a"), place(5, name="b")])) == ["a0", "a1", "b0"]
    assert list(merge([place(5, 5, name="a"), place(5, 5, name="b")])) == ["a0", "a1", "b0", "b1"]


def test_a_place_is_opened_when_the_order_comes_to_it() -> None:
    opened: list[str] = []
    things = merge([place(1, 2, name="a", opened=opened), place(3, 4, name="b", opened=opened)])
    assert [next(things), next(things)] == ["a0", "a1"] and opened == ["a"]
    assert [*things] == ["b0", "b1"] and opened == ["a", "b"]


def test_the_last_place_is_read_to_its_end() -> None:
    assert list(merge([place(1, name="a"), place(2, 3, 4, name="b")])) == ["a0", "b0", "b1", "b2"]


@given(st.lists(st.lists(st.integers(0, 9), min_size=1).map(sorted), max_size=6))
def test_as_sorting_has_it(times: list[list[int]]) -> None:
    places = [place(*one, name=f"{number}:") for number, one in enumerate(times)]
    every = [
        (time, place_number, f"{place_number}:{number}")
        for place_number, one in enumerate(times)
        for number, time in enumerate(one)
    ]
    every.sort(key=lambda one: one[:2])
    assert list(merge(places)) == [name for _, _, name in every]


def test_of_messages_with_one_time_those_of_the_earlier_file_come_first(tmp_path: Path) -> None:
    def message(time: int, text: str) -> Said:
        return Said(START + time, START, 0, "/chatter", text)

    first, second = [message(5, "first")], [message(3, "second"), message(5, "third")]
    with open_bag(write_bag(tmp_path / "walk", first, second)) as reader:
        assert [one.text for one in read(reader)] == ["second", "first", "third"]
