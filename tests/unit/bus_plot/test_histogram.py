"""A histogram of times: its quantiles are near the truth."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.base.time_parts import PARTS, bounds, part_of
from bus_plot.histogram import histogram, lines, quantile


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
