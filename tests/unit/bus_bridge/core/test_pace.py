from bus_bridge.core.pace import GATHER_S, Pace
from rows import for_each

_CLOSE_S, _APART_S = 0.0001, 0.0005


def until_they_gather(pace: Pace, now_s: float) -> float:
    """Send messages without a pause until they gather. Returns the time of the message with which that
    begins.
    """
    for _ in range(100):
        if not pace.leaves(now_s):
            return now_s
        now_s += _CLOSE_S
    raise AssertionError("they never gather")


@for_each("first_s", [0.0, 0.00001, 1e6])  # the loop's clock may start at any time
def test_a_few_without_a_pause_leave_at_once(first_s: float) -> None:
    pace = Pace()
    assert all(pace.leaves(first_s + at * _CLOSE_S) for at in range(8))
    assert not pace.is_gathering


def test_messages_with_a_pause_between_them_always_leave_at_once() -> None:
    pace = Pace()
    assert all(pace.leaves(1 + at * _APART_S) for at in range(1000))


def test_messages_that_come_in_small_groups_always_leave_at_once() -> None:
    pace = Pace()
    assert all(pace.leaves(1 + at * 0.01 + of * _CLOSE_S) for at in range(100) for of in range(8))


def test_many_without_a_pause_gather() -> None:
    pace = Pace()
    until_they_gather(pace, 1)
    assert pace.is_gathering
    pace.gathered(2)
    assert not pace.is_gathering


def test_as_long_as_there_is_no_pause_they_gather_again_at_once() -> None:
    pace = Pace()
    now_s = until_they_gather(pace, 1)
    for _ in range(10):
        now_s += GATHER_S
        pace.gathered(now_s)
        now_s += _CLOSE_S
        assert not pace.leaves(now_s)


def test_after_a_pause_they_leave_at_once_again() -> None:
    pace = Pace()
    now_s = until_they_gather(pace, 1) + GATHER_S
    pace.gathered(now_s)
    assert all(pace.leaves(now_s + _APART_S + at * _CLOSE_S) for at in range(8))
