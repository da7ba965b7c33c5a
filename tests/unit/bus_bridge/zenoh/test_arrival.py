"""What has arrived: in order, once, and asked for where it is missing."""

from collections import deque
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.engine import Sample
from bus_bridge.zenoh.arrival import HELD_BYTES, Arrival


def some(*numbers: int) -> list[Sample]:
    return [Sample(b"x", number, 0) for number in numbers]


def test_a_best_effort_route_passes_everything_on() -> None:
    arrival = Arrival(reliable=False, asks=False)
    assert arrival.arrive(some(3, 4), 0) == some(3, 4)
    assert arrival.arrive(some(9), 0) == some(9)
    assert not arrival.asking


def test_what_is_kept_comes_first() -> None:
    arrival = Arrival(reliable=False, asks=True)
    assert arrival.arrive(some(4, 5), 0) == ()
    assert arrival.answer(some(1, 2), 5) == some(1, 2)
    assert arrival.asking
    assert arrival.answer(some(3, 4, 5), 5) == some(3, 4, 5)
    assert not arrival.asking
    assert arrival.arrive(some(6), 0) == some(6)


def test_a_gap_is_asked_for() -> None:
    arrival = Arrival(reliable=True, asks=True)
    assert arrival.answer([], 10) == []
    assert arrival.last == 10 and not arrival.asking
    assert arrival.arrive(some(11), 10) == some(11)
    assert arrival.arrive(some(14), 13) == ()
    assert arrival.asking
    assert arrival.answer(some(12, 13), 14) == some(12, 13, 14)
    assert not arrival.asking


def test_a_second_copy_is_dropped() -> None:
    arrival = Arrival(reliable=True, asks=False)
    assert arrival.arrive(some(1, 2), 0) == some(1, 2)
    assert arrival.arrive(some(1, 2, 3), 0) == some(3)
    assert arrival.arrive(some(2), 1) == []


def test_what_is_not_kept_any_more_is_not_waited_for() -> None:
    arrival = Arrival(reliable=True, asks=False)
    assert arrival.arrive(some(9), 8) == ()
    assert arrival.answer([], 9) == []
    assert not arrival.asking and arrival.last == 9


def test_what_is_held_is_bounded() -> None:
    big = bytes(HELD_BYTES // 4)
    lossy = Arrival(reliable=False, asks=True)
    sure = Arrival(reliable=True, asks=True)
    for arrival in (lossy, sure):
        for number in range(2, 10):
            arrival.arrive([Sample(big, number, 0)], number - 1)
    assert lossy.dropped == 4 and sure.dropped == 0
    assert [one.number for one in lossy.answer([], 9)] == [6, 7, 8, 9]
    assert [one.number for one in sure.answer(some(1), 9)] == [1, 2, 3, 4, 5]
    assert [one.number for one in sure.arrive(some(10), 9)] == [] and sure.asking


@given(st.integers(0, 10**9), st.integers(1, 60))
def test_whatever_zenoh_drops_everything_arrives_once_in_order(seed: int, total: int) -> None:
    chance = Random(seed)
    arrival = Arrival(reliable=True, asks=True)
    got: list[int] = []
    sent = 0
    late: deque[tuple[list[Sample], int]] = deque()

    def ask() -> None:
        piece = some(*range(arrival.last + 1, min(sent, arrival.last + 3) + 1))
        got.extend(one.number for one in arrival.answer(piece, sent))

    while sent < total:
        first, sent = sent + 1, min(total, sent + chance.randint(1, 4))
        late.append((some(*range(first, sent + 1)), first - 1))
        while late and chance.random() < 0.7:
            put = late.popleft()
            if chance.random() < 0.7:
                got.extend(one.number for one in arrival.arrive(*put))
        if arrival.asking and chance.random() < 0.5:
            ask()
    got.extend(one.number for one in arrival.arrive([], sent))  # a probe
    while arrival.asking:
        ask()
    assert got == list(range(1, total + 1))
