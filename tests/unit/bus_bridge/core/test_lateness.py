import pytest

from bus_bridge.core.lateness import Lateness

_S = 1_000_000_000
_HOUR = 3600 * _S


@pytest.mark.parametrize("offset_ns", [0, _HOUR, -_HOUR])
def test_age_is_what_a_message_is_later_than_the_least_late(offset_ns: int) -> None:
    lateness = Lateness()
    for second in range(10):
        now_ns = 100 * _S + second * _S
        lateness.note(now_ns, now_ns - 1_000_000 + offset_ns)
    now_ns = 110 * _S
    assert lateness.age_ns(now_ns, now_ns - 1_000_000 + offset_ns) == 0
    assert lateness.age_ns(now_ns, now_ns - 2 * _S - 1_000_000 + offset_ns) == 2 * _S


def test_the_first_message_counts_as_new() -> None:
    assert Lateness().age_ns(100 * _S, 50 * _S) == 0


def test_a_clock_that_was_set_counts_after_a_minute() -> None:
    lateness = Lateness()
    lateness.note(100 * _S, 100 * _S)
    for second in range(101, 200):  # the far clock was set back by 10 s
        lateness.note(second * _S, second * _S - 10 * _S)
    assert lateness.age_ns(200 * _S, 190 * _S) == 0
    assert lateness.age_ns(200 * _S, 185 * _S) == 5 * _S


def test_after_a_long_silence_all_begins_anew() -> None:
    lateness = Lateness()
    lateness.note(100 * _S, 100 * _S)
    lateness.note(10_000 * _S, 9_000 * _S)
    assert lateness.age_ns(10_000 * _S, 9_000 * _S) == 0
