"""Received parts: in order, once each, with requests for missing parts."""

from collections import deque
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.zenoh.arrival import HELD_BYTES, Arrival, Untaken
from bus_bridge.zenoh.records import Content, Probe, Room


def content(number: int) -> Content:
    return Loose([Sample(b"x", number, 0)])


def numbers(contents: list[Content]) -> list[int]:
    return [sample.number for one in contents if isinstance(one, Batch) for sample in one]


def arrive(arrival: Arrival, number: int, size: int = 1) -> list[int]:
    return numbers(arrival.arrive(number, content(number), size))


def test_what_comes_before_the_route_begins_is_held() -> None:
    arrival = Arrival(Room(1 << 30))
    assert arrive(arrival, 6) == [] and arrive(arrival, 5) == [] and arrive(arrival, 4) == []
    assert not arrival.misses
    assert numbers(arrival.begin(4)) == [5, 6]
    assert arrive(arrival, 7) == [7]


def test_a_gap_is_asked_for() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(10)
    assert arrive(arrival, 11) == [11] and not arrival.misses
    assert arrive(arrival, 14) == [] and arrival.misses
    assert arrive(arrival, 12) == [12] and arrival.misses
    assert arrive(arrival, 13) == [13, 14] and not arrival.misses


def test_several_missing_parts_are_asked_for_at_once() -> None:
    arrival = Arrival(Room(1 << 30))
    arrive(arrival, 14)
    assert arrival.missing(10) == []  # the beginning of the route is not known yet
    arrival.begin(10)
    arrive(arrival, 17)
    assert arrival.missing(10) == [11, 12, 13, 15, 16]
    assert arrival.missing(4) == [11, 12, 13, 15]
    assert arrive(arrival, 11) == [11] and arrival.missing(10) == [12, 13, 15, 16]
    arrival.arrive(1 << 63, Probe(), 0)  # the far side may send any number
    assert arrival.missing(5) == [12, 13, 15, 16, 18]


def test_a_second_copy_is_dropped() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(0)
    assert arrive(arrival, 1) == [1]
    assert arrive(arrival, 1) == []
    assert arrive(arrival, 3) == arrive(arrival, 3) == []
    assert arrive(arrival, 2) == [2, 3]


def test_a_probe_tells_what_is_missing_at_the_end() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(0)
    assert arrival.arrive(2, Probe(), 0) == [] and arrival.misses
    assert arrive(arrival, 1) == [1] and arrival.misses
    assert arrive(arrival, 2) == [2] and not arrival.misses


def test_what_is_not_kept_any_more_is_not_waited_for() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(0)
    assert arrive(arrival, 5) == [] and arrive(arrival, 6) == []
    assert numbers(arrival.skip(6)) == [5, 6] and not arrival.misses
    arrival.arrive(9, Probe(), 0)
    assert arrival.skip(9) == [] and not arrival.misses
    assert arrive(arrival, 10) == [10]
    assert arrive(arrival, 14) == []
    assert arrival.skip(12) == [] and arrival.last == 12
    assert arrive(arrival, 13) == [13, 14]


def test_a_forged_number_skips_no_part() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(0)
    assert arrive(arrival, 1) == [1]
    arrival.arrive(1 << 40, Probe(), 0)
    assert arrival.misses  # the far side is asked, and has no part after the first
    assert arrival.skip(1) == [] and not arrival.misses
    assert (arrival.last, arrive(arrival, 2)) == (1, [2])
    assert arrive(arrival, 1 << 40) == [] and arrival.misses
    assert arrival.skip(2) == [] and not arrival.misses
    assert arrive(arrival, 3) == [3]
    assert arrival.skip(1) == [] and arrival.last == 3  # an answer from before


def test_what_is_held_is_bounded() -> None:
    arrival = Arrival(Room(1 << 30))
    arrival.begin(0)
    for number in range(2, 12):
        arrive(arrival, number, HELD_BYTES // 4 - 1000)
    assert arrive(arrival, 1) == [1, 2, 3, 4, 5]
    assert arrival.misses
    for number in range(6, 12):
        assert arrive(arrival, number, HELD_BYTES // 4) == [number]
    assert not arrival.misses


def test_what_is_held_is_bounded_however_small_it_is_and_of_all_ways_together() -> None:
    room = Room(HELD_BYTES + 10_000)
    arrivals = [Arrival(room) for _ in range(10)]
    for arrival in arrivals:
        arrival.begin(0)
    for number in range(2, 100_000):
        arrivals[0].arrive(number, content(number), 0)
    assert 0 < room.left < 11_000
    for number in range(2, 1000):
        for arrival in arrivals[1:]:
            arrive(arrival, number)
    assert 0 <= room.left < 1000
    assert arrive(arrivals[1], 1)[:2] == [1, 2]  # a request brings the missing part
    for arrival in arrivals:
        arrival.clear()
    assert room.left == HELD_BYTES + 10_000


@given(st.integers(0, 10**9), st.integers(1, 60), st.integers(0, 5))
def test_whatever_zenoh_drops_everything_arrives_once_in_order(seed: int, total: int, base: int) -> None:
    chance = Random(seed)
    arrival = Arrival(Room(1 << 30))
    got: list[int] = []
    late: deque[int] = deque()

    def ask() -> None:
        got.extend(arrive(arrival, arrival.last + 1))

    for sent in range(base + 1, base + total + 1):
        late.append(sent)
        while late and chance.random() < 0.7:
            number = late.popleft()
            if chance.random() < 0.7:
                got.extend(arrive(arrival, number))
        if not arrival.is_begun and chance.random() < 0.3:
            got.extend(numbers(arrival.begin(base)))
        if arrival.misses and chance.random() < 0.5:
            ask()
    if not arrival.is_begun:
        got.extend(numbers(arrival.begin(base)))
    arrival.arrive(base + total, Probe(), 0)
    while arrival.misses:
        ask()
    assert got == list(range(base + 1, base + total + 1))


def test_a_part_is_taken_with_the_last_byte_of_its_messages() -> None:
    untaken = Untaken()
    for number, size in ((1, 10), (2, 5), (3, 7)):
        untaken.add(number, size)
    for size, last in ((9, 0), (1, 1), (6, 2), (6, 3)):
        untaken.take(size)
        assert untaken.last_taken() == last


def test_parts_without_bytes_go_with_the_one_before_and_fill_nothing() -> None:
    untaken = Untaken()
    for number in range(1, 100):
        untaken.add(number, 0)
    assert (len(untaken), untaken.last_taken()) == (1, 99)
    untaken.add(100, 3)
    untaken.add(101, 0)
    assert (len(untaken), untaken.last_taken()) == (1, 99)
    untaken.take(3)
    assert untaken.last_taken() == 101
