"""A histogram of times: its parts join without a hole, and quantiles are near the truth."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_plot.histogram import PARTS, bounds, histogram, lines, part_of, quantile

TIMES = st.integers(0, 10**11)


@given(TIMES)
def test_each_time_is_within_the_bounds_of_its_part(time_ns: int) -> None:
    part = part_of(time_ns)
    begin, end = bounds(part)
    assert begin <= time_ns
    assert time_ns < end or part == PARTS - 1


def test_parts_join() -> None:
    assert (bounds(0), bounds(1), bounds(2), bounds(3)) == (
        (0, 1024),
        (1024, 1536),
        (1536, 2048),
        (2048, 3072),
    )
    assert all(bounds(part)[1] == bounds(part + 1)[0] for part in range(PARTS - 1))
    assert bounds(PARTS - 1)[0] == 1 << 34
    assert (part_of(-5), part_of(0), part_of(10**12)) == (0, 0, PARTS - 1)


@given(st.lists(st.integers(1024, 10**10), min_size=1, max_size=200), st.sampled_from([0.5, 0.9, 0.99]))
def test_quantiles_are_in_the_right_part(times_ns: list[int], share: float) -> None:
    found = quantile(histogram(times_ns), share)
    exact = sorted(times_ns)[max(0, math.ceil(share * len(times_ns) - 1e-9) - 1)]
    begin, end = bounds(part_of(exact))
    assert begin <= found <= end


def test_quantiles() -> None:
    counts = histogram([2_000] * 98 + [900_000] * 2)
    assert quantile(counts, 0.5) == pytest.approx(1_797, abs=1)
    assert 786_432 < quantile(counts, 0.99) < 1_048_576
    assert quantile([0] * PARTS, 0.5) == 0.0


def test_lines() -> None:
    assert lines(histogram([1_100] * 4 + [2_100] * 2 + [3_500]), cells=8) == [
        "1.02 µs ... 1.54 µs ▇▇▇▇▇▇▇▇ 4",
        "1.54 µs ... 2.05 µs          0",
        "2.05 µs ... 3.07 µs ▇▇▇▇     2",
        " 3.07 µs ... 4.1 µs ▇▇       1",
    ]
    assert lines([0] * PARTS) == []
    assert lines(histogram([10**11]))[0].startswith("17.2 s ... ")
