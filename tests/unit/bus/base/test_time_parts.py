"""The parts of a histogram of times join without a hole."""

from hypothesis import given
from hypothesis import strategies as st

from bus.base.time_parts import PARTS, bounds, part_of, trimmed


@given(st.integers(0, 10**11))
def test_each_time_is_within_the_bounds_of_its_part(time_ns: int) -> None:
    part = part_of(time_ns)
    begin, end = bounds(part)
    assert begin <= time_ns
    assert time_ns < end or part == PARTS - 1


def test_parts_join() -> None:
    assert [bounds(part) for part in range(4)] == [(0, 1024), (1024, 1536), (1536, 2048), (2048, 3072)]
    assert all(bounds(part)[1] == bounds(part + 1)[0] for part in range(PARTS - 1))
    assert bounds(PARTS - 1)[0] == 1 << 34
    assert (part_of(-5), part_of(0), part_of(10**12)) == (0, 0, PARTS - 1)


def test_trimmed() -> None:
    assert trimmed([0, 2, 0, 1, 0]) == (0, 2, 0, 1)
    assert trimmed([0, 0]) == ()
