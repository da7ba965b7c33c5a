"""Rates from counters: steady, at first, after silence, after a restart; values of each second."""

from bus_web.rates import HISTORY_S, Meter, RateHistory
from rows import for_each

S = 1_000_000_000


def test_none_until_told_twice() -> None:
    meter = Meter()
    assert meter.rates(0) is None
    meter.add(0, 5, 50)  # its process has not sent the time
    assert meter.rates(S) is None
    meter.add(S, 5, 50)
    meter.add(S, 5, 50)  # the same sample again
    assert meter.rates(2 * S) is None
    meter.add(3 * S // 2, 10, 150)
    assert meter.rates(2 * S) == (10.0, 200.0)


@for_each(
    ("hz", "pause_ns", "jitter"),
    [(10, S // 2, 0.25), (1000, S // 2, 0.01), (1, S, 0.01), (0.2, 5 * S, 0.01)],
)
def test_a_steady_rate_is_steady(hz: float, pause_ns: int, jitter: float) -> None:
    meter, rates = Meter(), []
    for turn in range(1, 30):
        at_ns = turn * pause_ns + 10_000_000
        meter.add(at_ns, int(at_ns * hz / S + 1e-6))
        if turn > 5:
            rates += [meter.rates(at_ns + wait_ns) for wait_ns in (0, pause_ns // 2)]
    assert all(one is not None and abs(one[0] - hz) <= jitter * hz for one in rates)


def test_who_falls_silent_comes_to_zero() -> None:
    meter = Meter()
    meter.add(S, 0)
    meter.add(3 * S // 2, 50)
    assert meter.rates(3 * S) == (100.0,)
    assert meter.rates(5 * S) == (0.0,)


def test_a_lower_count_begins_anew() -> None:
    meter = Meter()
    meter.add(S, 1000)
    meter.add(2 * S, 1100)
    meter.add(3 * S, 4)
    assert meter.rates(3 * S) is None
    meter.add(4 * S, 14)
    assert meter.rates(4 * S) == (10.0,)


def test_a_value_for_each_second() -> None:
    seconds = RateHistory()
    assert seconds.add(7 * S, 1.0)
    assert not seconds.add(7 * S + S // 2, 2.0)
    assert seconds.add(8 * S, 3.0)
    assert seconds.add(8 * S + 9 * S // 10, 4.0), "a look that comes a little early is the next second's"
    assert seconds.add(12 * S, 5.0)
    assert seconds.values == (1.0, 3.0, 4.0, 5.0, 5.0, 5.0)
    seconds.add(1000 * S, 6.0)
    assert seconds.values == (6.0,) * HISTORY_S


def test_a_rate_is_taken_over_at_least_two_seconds() -> None:
    """This smooths bursts, too. The sample before the window counts."""
    meter = Meter()
    for second, count in ((1, 0), (2, 0), (3, 100), (4, 100)):
        meter.add(second * S, count)
    assert meter.rates(4 * S) == (50.0,)
    meter.add(5 * S, 100)
    assert meter.rates(5 * S) == (0.0,)
