"""Stretches of messages, and the gaps between them."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from bus_bag.storage.stretches import Stretch, gaps_between, split


def test_a_gap_of_just_the_limit_parts_nothing() -> None:
    assert list(split([1, 2, 12, 23], 10)) == [Stretch(1, 12), Stretch(23, 23)]
    assert list(split([], 10)) == []


def test_a_stretch_of_one_file_covers_the_gap_of_another() -> None:
    stretches = [Stretch(0, 5), Stretch(100, 105), Stretch(4, 60)]
    assert gaps_between(stretches, 10) == [Stretch(60, 100)]
    assert gaps_between(stretches, 40) == []
    assert gaps_between([], 10) == []


@given(st.lists(st.lists(st.integers(0, 1000))), st.integers(0, 50))
def test_the_gaps_are_those_of_all_times_together(files: list[list[int]], least: int) -> None:
    times = sorted(time for file in files for time in file)
    expected = [Stretch(*pair) for pair in pairwise(times) if pair[1] - pair[0] > least]
    assert gaps_between((one for file in files for one in split(sorted(file), least)), least) == expected
