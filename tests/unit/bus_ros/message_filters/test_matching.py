"""matching: rules at their limits. tests/property/test_message_filters.py has the rest."""

from typing import Any

from bus_ros.message_filters.matching import bound, match_approximately


def queues(*stamps: list[int]) -> list[dict[int, Any]]:
    return [dict.fromkeys(one) for one in stamps]


def test_the_oldest_by_stamp_gives_way() -> None:
    (queue,) = queues([5, 3, 9, 4])
    bound(queue, 2)
    assert list(queue) == [5, 9]


def test_less_than_the_slop_apart() -> None:
    assert match_approximately(queues([100], [109]), 1, 109, 10) == (100, 109)
    assert match_approximately(queues([100], [110]), 1, 110, 10) is None
    assert match_approximately(queues([100], [100]), 1, 100, 0) is None


def test_the_nearest_and_of_two_the_first_that_came() -> None:
    assert match_approximately(queues([90, 98, 103], [100]), 1, 100, 20) == (98, 100)
    assert match_approximately(queues([103, 97], [100]), 1, 100, 20) == (103, 100)


def test_what_is_nearest_gives_way_where_the_others_are_too_far_from_it() -> None:
    assert match_approximately(queues([97, 104], [100], [107]), 1, 100, 10) == (104, 100, 107)


def test_a_message_that_was_too_old_for_its_full_queue() -> None:
    assert match_approximately(queues([100], [104]), 1, 99, 10) is None


def test_many_that_fit_in_pairs_and_never_all() -> None:
    """A search set by set would look at 1e21 sets."""
    both = [*range(30), *range(170, 200)]
    found = match_approximately(queues(*[both] * 12, [100], [0], [200]), 12, 100, 110)
    assert found is None
