"""The windows of hz, bw and delay."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.base.time_parts import part_of
from bus_cli.stats import Bandwidth, Delays, Flow, Intervals, spread
from rows import for_each

S = 1_000_000_000


@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=50))
def test_spread_is_of_the_population(values: list[float]) -> None:
    found = spread(values)
    assert found.mean == pytest.approx(statistics.fmean(values), abs=1e-6)
    assert found.deviation == pytest.approx(statistics.pstdev(values), abs=1e-4)
    assert (found.least, found.most, found.window) == (min(values), max(values), len(values))


def feed(intervals: Intervals, times_s: list[float]) -> list[int]:
    """The windows that are printed while messages arrive at `times_s`."""
    printed = []
    for time_s in times_s:
        intervals.add(round(time_s * S))
        found = intervals.due()
        if found is not None:
            printed.append(found.window)
    return printed


def test_two_hertz_are_printed_when_ros2_prints_them() -> None:
    # `ros2 topic hz` of the lesson's publisher printed the windows 3, 5, ...
    assert feed(Intervals(10000), [1 + 0.5 * n for n in range(10)]) == [3, 5, 7, 9]


def test_the_gaps_are_measured() -> None:
    intervals = Intervals(10000)
    assert feed(intervals, [1.0, 1.5, 2.0]) == []
    intervals.add(round(2.6 * S))
    found = intervals.due()
    assert found is not None
    assert (found.least, found.most) == (0.5 * S, 0.6 * S)
    assert 1 / (found.mean / S) == pytest.approx(1.875)
    assert found.deviation / S == pytest.approx(math.sqrt(0.02 / 9))


def test_nothing_is_printed_twice_nor_before_the_second_message() -> None:
    intervals = Intervals(10)
    assert intervals.due() is None
    intervals.add(S)
    assert intervals.due() is None
    assert feed(intervals, [2.0, 3.0]) == [2]
    assert intervals.due() is None


def test_a_table_shows_what_is_new() -> None:
    intervals = Intervals(10)
    assert intervals.new() is None
    intervals.add(S)
    assert intervals.new() is None
    intervals.add(S + 1)
    assert intervals.new() == spread([1])
    assert intervals.new() is None
    intervals.add(S + 4)
    assert intervals.new() == spread([1, 3])


def test_only_the_window_counts() -> None:
    intervals = Intervals(2)
    assert feed(intervals, [1.0, 9.0, 10.0, 11.0])[-1] == 2
    found = spread([1.0 * S, 1.0 * S])
    intervals.add(12 * S)
    assert intervals.due() == found


def test_bandwidth_is_from_the_first_of_the_window_until_now() -> None:
    bandwidth = Bandwidth(100)
    assert bandwidth.rate(0) is None
    bandwidth.add(0, 24)
    assert bandwidth.rate(S) is None
    bandwidth.add(S // 2, 28)
    found = bandwidth.rate(2 * S)
    assert found is not None
    rate, sizes = found
    assert rate == pytest.approx(26.0)
    assert (sizes.mean, sizes.least, sizes.most, sizes.window) == (26.0, 24, 28, 2)


def test_bandwidth_keeps_its_window() -> None:
    bandwidth = Bandwidth(3)
    for number in range(10):
        bandwidth.add(number * S, number)
    found = bandwidth.rate(10 * S)
    assert found is not None
    assert found[0] == pytest.approx((7 + 8 + 9) / 3)
    assert found[1].window == 3


def test_bandwidth_needs_time_to_pass() -> None:
    bandwidth = Bandwidth(3)
    bandwidth.add(S, 1)
    bandwidth.add(S, 1)
    assert bandwidth.rate(S) is None


def test_delays_leave_out_the_first_and_tell_what_is_new() -> None:
    delays = Delays(10)
    assert delays.is_empty
    assert delays.due() is None
    delays.add(100)
    assert delays.is_empty
    delays.add(4)
    delays.add(6)
    assert delays.due() == (5.0, 4, 6, 1.0, 2)
    assert not delays.is_empty
    assert delays.due() is None
    delays.add(8)
    found = delays.due()
    assert found is not None
    assert found.window == 3


def test_delays_keep_their_window() -> None:
    delays = Delays(2)
    for delay in (0, 1, 2, 3):
        delays.add(delay)
    assert delays.due() == (2.5, 2, 3, 0.5, 2)


def test_delays_as_a_histogram() -> None:
    delays = Delays(100)
    for delay in (0, *range(2_000, 102_000, 1_000)):
        delays.add(delay)
    half, most, counts = delays.histogram()
    assert (half, most, sum(counts)) == (51_000, 100_000, 100)
    assert counts[part_of(2_000)] == 1
    one = Delays(1)
    one.add(0)
    one.add(7)
    assert one.histogram()[:2] == (7, 7)


def flow_of(*messages: tuple[bytes, int, float]) -> Flow:
    flow = Flow()
    for publisher, number, time_s in messages:
        flow.add(publisher, number, round(time_s * S))
    return flow


def test_flow_needs_two_moments() -> None:
    assert flow_of().rates() is None
    assert flow_of((b"a", 7, 1)).rates() is None
    assert flow_of((b"a", 7, 1), (b"b", 1, 1)).rates() is None


@for_each("heard", [2, 30, 31, 59])
def test_flow_of_a_camera_that_loses_nothing(heard: int) -> None:
    """At any moment, both rates equal the camera's rate."""
    rates = flow_of(*((b"camera", 100 + n, 5 + n / 30) for n in range(heard))).rates()
    assert rates == pytest.approx((30, 30))


def test_flow_counts_what_was_lost() -> None:
    flow = flow_of(*((b"camera", n, n / 30) for n in range(1, 62) if n % 3 == 1))
    assert (flow.published, flow.received) == (61, 21)
    assert flow.rates() == pytest.approx((30, 10))


def test_flow_of_several_publishers_that_come_and_go() -> None:
    first = [(b"a", n, n / 10) for n in range(1, 21)]
    second = [(b"b", n, 1 + n / 10) for n in range(1, 21)]
    flow = flow_of(*sorted(first + second, key=lambda one: one[2]))
    assert (flow.published, flow.received) == (40, 40)
    assert flow.rates() == pytest.approx((39 / 2.9, 39 / 2.9))


def test_flow_takes_them_in_any_order() -> None:
    """For example, history may arrive after newer messages."""
    assert flow_of((b"a", 3, 3), (b"a", 1, 1), (b"a", 2, 2)).rates() == (1.0, 1.0)
