"""Percentiles of lateness."""

from hypothesis import given
from hypothesis import strategies as st

from bus_bag.play.lateness import Lateness


def test_nothing_was_late() -> None:
    assert str(Lateness()) == "p50 0.000 ms, p99 0.000 ms, max 0.000 ms"


def test_the_words() -> None:
    late = Lateness()
    for late_ns in [60_000] * 98 + [900_000, 2_000_001]:
        late.add(late_ns)
    assert (late.count, late.max_ns) == (100, 2_000_001)
    assert str(late) == "p50 0.059 ms, p99 0.885 ms, max 2.000 ms"


@given(st.lists(st.integers(0, 10**11), min_size=1), st.sampled_from([1, 50, 99, 100]))
def test_percentiles_are_right_to_a_thirtieth(times: list[int], percent: int) -> None:
    late = Lateness()
    for late_ns in times:
        late.add(late_ns)
    exact = sorted(times)[-(-len(times) * percent // 100) - 1]
    assert exact * 31 / 32 - 1 <= late.percentile(percent) <= exact
