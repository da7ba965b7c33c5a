"""What a publisher's way out keeps, and for how long."""

from bus_bridge.engine import Sample
from bus_bridge.zenoh.window import HISTORY_BYTES, WINDOW_BYTES, Kept


def some(first: int, last: int, size: int = 1000) -> list[Sample]:
    return [Sample(bytes(size), number, 0) for number in range(first, last + 1)]


def numbers(samples: object) -> list[int]:
    assert isinstance(samples, list)
    return [one.number for one in samples]


def fill(kept: Kept, first: int = 1, size: int = 1000) -> int:
    """Until nothing fits; the number of the last."""
    number = first
    while kept.fitting(some(number, number, size)):
        kept.add(some(number, number, size))
        number += 1
    return number - 1


def test_without_an_importer_everything_goes() -> None:
    kept = Kept(reliable=True)
    assert kept.fitting(some(1, 9999)) == 9999
    kept.add(some(1, 9999))
    assert kept.in_flight == 0


def test_a_lossless_window_is_full_until_the_slowest_has_taken() -> None:
    kept = Kept(reliable=True, lossless=True)
    kept.join("a")
    kept.join("b")
    last = 0
    while (more := fill(kept, last + 1)) > last:
        kept.hear("a", more, more)
        kept.hear("b", more, 0)  # it has arrived there, and nobody takes it
        last = more
    assert WINDOW_BYTES - 1020 < kept.in_flight <= WINDOW_BYTES
    assert kept.hear("b", last, last)
    assert kept.in_flight == 0
    assert kept.fitting(some(last + 1, last + 1)) == 1


def test_an_importer_that_goes_is_waited_for_no_more() -> None:
    kept = Kept(reliable=True, lossless=True)
    kept.join("a")
    kept.join("hung")
    last = fill(kept)
    kept.hear("a", last, last)
    assert kept.fitting(some(last + 1, last + 1)) == 0
    kept.leave("hung")
    assert kept.in_flight == 0
    assert kept.fitting(some(last + 1, last + 1)) == 1


def test_of_a_reliable_route_arrival_is_enough() -> None:
    kept = Kept(reliable=True)
    kept.join("a")
    last = fill(kept)
    kept.hear("a", last, 0)
    assert kept.in_flight == 0


def test_a_message_larger_than_the_window_goes_alone() -> None:
    kept = Kept(reliable=True, lossless=True)
    kept.join("a")
    huge = [Sample(bytes(2 * WINDOW_BYTES), 2, 0)]
    kept.add(some(1, 1))
    assert kept.fitting(huge) == 0
    kept.hear("a", 1, 1)
    assert kept.fitting(huge) == 1
    kept.add(huge)
    assert kept.fitting(some(3, 3)) == 0
    kept.hear("a", 2, 2)
    assert kept.fitting(some(3, 3)) == 1


def test_what_is_missing_is_found_and_less_goes_at_a_time() -> None:
    kept = Kept(reliable=True, lossless=True)
    kept.join("a")
    last = fill(kept)
    kept.hear("a", 10, 0)
    found = kept.find("a", 10)
    assert numbers(found)[:3] == [11, 12, 13]
    assert sum(len(one.payload) for one in found or ()) < 64 << 10
    kept.hear("a", last, last)
    shrunk = fill(kept, last + 1) - last
    assert shrunk < last * 3 / 4
    assert kept.find("stranger", 0) is None


def test_it_grows_again() -> None:
    kept = Kept(reliable=True)
    kept.join("a")
    first = last = fill(kept)
    for _ in range(100):
        kept.hear("a", last, 0)
        before, last = last, fill(kept, last + 1)
    assert 2 * first < last - before <= WINDOW_BYTES / 1000


def test_importers_get_only_what_came_after_them_but_of_transient_local() -> None:
    volatile = Kept(reliable=True)
    latched = Kept(reliable=True, history=3)
    for kept in (volatile, latched):
        kept.join("a")
        kept.add(some(1, 5))
        kept.join("late")
        kept.add(some(6, 7))
    assert numbers(volatile.find("late", 0)) == [6, 7]
    assert numbers(latched.find("late", 0)) == [1, 2, 3, 4, 5, 6, 7]  # all that is there for "a"
    latched.hear("a", 7, 7)
    latched.hear("late", 7, 7)
    assert numbers(latched.find("late", 0)) == [5, 6, 7]
    assert numbers(latched.find("late", 6)) == [7]


def test_a_history_is_bounded_in_bytes() -> None:
    kept = Kept(reliable=False, history=1000)
    kept.join("a")
    size = HISTORY_BYTES // 4
    kept.add(some(1, 10, size))
    assert numbers(kept.find("a", 0)) == [7]  # a piece at a time
    kept.add(some(11, 11, 2 * HISTORY_BYTES))
    assert numbers(kept.find("a", 0)) == [11]


def test_numbers_that_were_never_sent_count_as_the_newest() -> None:
    kept = Kept(reliable=True, lossless=True)
    kept.join("a")
    kept.add(some(1, 3))
    assert kept.hear("a", 2**64 - 1, 2**64 - 1)
    assert kept.in_flight == 0
    kept.add(some(4, 4))
    assert kept.in_flight == 1020
    assert not kept.hear("a", 1, 1)
    assert not kept.hear("stranger", 4, 4)
    assert not kept.has_arrived
    assert kept.hear("a", 4, 0) and kept.has_arrived and kept.in_flight == 1020


def test_importers_are_asked_a_few_times_in_a_span() -> None:
    kept = Kept(reliable=True)
    kept.join("a")
    asked = 0
    number = 1
    while kept.fitting(some(number, number)):
        kept.add(some(number, number))
        asked += kept.must_ask()
        number += 1
    assert 3 <= asked <= 4
