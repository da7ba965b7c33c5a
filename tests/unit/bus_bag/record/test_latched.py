"""The state of latched topics."""

from bus_bag.record import latched
from bus_bag.record.latched import RETURN_NS, LatchedState

A, B = b"a", b"b"


def state(offers: dict[bytes, int]) -> LatchedState[int]:
    made: LatchedState[int] = LatchedState()
    made.set_publishers("/map", offers, 0)
    return made


def add(made: LatchedState[int], publisher: bytes, *messages: int, is_written: bool = True) -> None:
    for message in messages:
        made.add("/map", publisher, message, 10, is_written=is_written)


def kept(made: LatchedState[int], now_ns: int = 0) -> list[int]:
    return [one.message for one in made.state(now_ns)]


def test_as_much_as_each_publisher_keeps() -> None:
    made = state({A: 1, B: 2})
    assert made.depth("/map", A) == 1
    assert not made.depth("/other", A)
    add(made, A, 1, 2, 3)
    add(made, B, 11, 12, 13)
    assert kept(made) == [3, 12, 13]


def test_a_publisher_that_has_gone_is_remembered_for_a_while() -> None:
    made = state({A: 1, B: 1})
    add(made, A, 1)
    add(made, B, 2)
    made.set_publishers("/map", {B: 1}, 5)
    assert kept(made, 5 + RETURN_NS) == [1, 2]
    assert kept(made, 6 + RETURN_NS) == [2]
    made.set_publishers("/map", {}, 10)
    made.set_publishers("/map", {B: 1}, 20)
    assert kept(made, 20 + 2 * RETURN_NS) == [2]


def test_bounds() -> None:
    made = state({A: 0})
    add(made, A, *range(latched.MOST_MESSAGES + 5))
    assert kept(made)[0] == 5
    made.add("/map", A, -1, latched.MOST_BYTES + 1, is_written=True)
    assert kept(made) == [-1]


def test_what_was_not_written_is_given_once() -> None:
    made = state({A: 3})
    add(made, A, 1)
    assert not made.has_unwritten
    add(made, A, 2, 3, is_written=False)
    assert made.has_unwritten
    assert [one.message for one in made.take_unwritten()] == [2, 3]
    assert (made.has_unwritten, made.take_unwritten(), kept(made)) == (False, [], [1, 2, 3])


def test_forgotten() -> None:
    made = state({A: 2})
    add(made, A, 1, 2)
    made.forget("/map", A, 2)
    made.forget("/map", B, 1)
    assert kept(made) == [1]
    add(made, A, 3)
    assert kept(made) == [1, 3]
