"""The bag's time and the machine's time: continuous, without drift, and each the inverse of the other."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bag.play.time_line import TimeLine

BAG = 1_795_342_862_882_115_714
NOW = 5_000_000_000_000
MS = 1_000_000

rates = st.floats(0.01, 100)
spans = st.integers(0, 3_600_000 * MS)
changes = st.lists(
    st.tuples(spans, st.one_of(st.just("pause"), st.just("resume"), rates, st.tuples(spans, spans))),
    max_size=20,
)


def test_it_runs_at_its_rate() -> None:
    line = TimeLine(BAG, NOW, 2.0)
    assert (line.bag_time(NOW), line.bag_time(NOW + MS)) == (BAG, BAG + 2 * MS)
    assert (line.due(BAG), line.due(BAG + 2 * MS)) == (NOW, NOW + MS)
    assert line.due(BAG - 2 * MS) == NOW - MS


def test_a_pause_takes_no_time_of_the_bag() -> None:
    line = TimeLine(BAG, NOW)
    line.pause(NOW + MS)
    assert line.is_paused and line.due(BAG) is None
    assert line.bag_time(NOW + 100 * MS) == BAG + MS
    line.pause(NOW + 50 * MS)
    line.resume(NOW + 100 * MS)
    line.resume(NOW + 200 * MS)
    assert line.due(BAG + 2 * MS) == NOW + 101 * MS
    assert line.bag_time(NOW + 103 * MS) == BAG + 4 * MS


def test_begun_in_a_pause() -> None:
    line = TimeLine(BAG, NOW, is_paused=True)
    assert (line.is_paused, line.bag_time(NOW + MS)) == (True, BAG)
    line.jump(BAG + 7, NOW + MS)
    line.resume(NOW + 2 * MS)
    assert line.due(BAG + 7) == NOW + 2 * MS


def test_skipping_leaves_a_delay_and_a_pause() -> None:
    line = TimeLine(BAG, NOW)
    line.jump(BAG, NOW, 10 * MS)
    line.skip_to(BAG + 500 * MS, NOW + 4 * MS)
    assert line.due(BAG + 500 * MS) == NOW + 10 * MS
    line.skip_to(BAG + 900 * MS, NOW + 20 * MS)
    assert line.due(BAG + 900 * MS) == NOW + 20 * MS
    line.pause(NOW + 20 * MS)
    line.skip_to(BAG + 1000 * MS, NOW + 21 * MS)
    line.resume(NOW + 30 * MS)
    assert line.due(BAG + 1000 * MS) == NOW + 30 * MS


def test_a_delay_stands_before_the_beginning_also_around_a_pause() -> None:
    line = TimeLine(BAG + 99, NOW)
    line.jump(BAG, NOW, 10 * MS)
    assert (line.bag_time(NOW + 9 * MS), line.due(BAG)) == (BAG, NOW + 10 * MS)
    line.set_rate(0.5, NOW + MS)
    line.pause(NOW + 4 * MS)
    line.resume(NOW + 1000 * MS)
    assert (line.bag_time(NOW + 1005 * MS), line.due(BAG)) == (BAG, NOW + 1006 * MS)
    assert line.bag_time(NOW + 1008 * MS) == BAG + MS


@pytest.mark.parametrize("rate", [0, -1.0, 1e-300, 1e300, math.inf, math.nan])
def test_what_is_no_rate(rate: float) -> None:
    line = TimeLine(BAG, NOW, 3.0)
    assert not line.set_rate(rate, NOW)
    assert line.rate == 3.0
    with pytest.raises(ValueError, match="a rate of"):
        TimeLine(BAG, NOW, rate)


@given(changes=changes)
def test_the_time_of_the_bag_never_jumps_by_itself(changes: list[tuple[int, object]]) -> None:
    line, now_ns = TimeLine(BAG, NOW), NOW
    for wait_ns, change in changes:
        before = line.bag_time(now_ns)
        now_ns += wait_ns
        after = line.bag_time(now_ns)
        assert after >= before
        match change:
            case "pause":
                line.pause(now_ns)
            case "resume":
                line.resume(now_ns)
            case float():
                assert line.set_rate(change, now_ns)
            case (int(to_ns), int(delay_ns)):
                after = BAG + to_ns
                line.jump(after, now_ns, delay_ns)
        assert line.bag_time(now_ns) == after


@given(rate=rates, later=st.integers(-3_600_000 * MS, 3_600_000 * MS), changes=changes)
def test_what_is_due_comes_when_it_is_due(rate: float, later: int, changes: list[tuple[int, object]]) -> None:
    line, now_ns = TimeLine(BAG, NOW, rate), NOW
    for wait_ns, change in changes:
        now_ns += wait_ns
        if isinstance(change, float):
            line.set_rate(change, now_ns)
        elif change == "pause":
            line.pause(now_ns)
            now_ns += wait_ns
            line.resume(now_ns)
    bag_ns = line.bag_time(now_ns) + later
    due_ns = line.due(bag_ns)
    assert due_ns is not None
    slack = round(line.rate) + 1  # one nanosecond of the machine, in the bag's time
    if due_ns >= now_ns:
        assert abs(line.bag_time(due_ns) - bag_ns) <= slack
    else:
        assert bag_ns <= line.bag_time(now_ns) + slack


@given(rate=rates, period_ns=st.integers(1, 10 * MS), count=st.integers(1, 1_000_000))
def test_nothing_drifts(rate: float, period_ns: int, count: int) -> None:
    line = TimeLine(BAG, NOW, rate)
    due_ns = line.due(BAG + count * period_ns)
    assert due_ns is not None
    assert abs(due_ns - NOW - count * period_ns / rate) <= 1
