"""The start of a new file."""

from bus_bag.record.splitting import Splitting

S = 1_000_000_000


def test_by_bytes() -> None:
    rule = Splitting(1000, 0)
    assert rule
    assert [rule.is_due(size, 0) for size in (5000, 999, 1000)] == [False, False, True]
    rule.split(1100)
    assert [rule.is_due(size, 0) for size in (1100, 2099, 2100)] == [False, False, True]


def test_by_time() -> None:
    rule = Splitting(0, 2)
    assert [rule.is_due(0, time) for time in (10 * S, 12 * S - 1, 12 * S)] == [False, False, True]
    rule.split(0)
    assert [rule.is_due(0, time) for time in (12 * S, 13 * S, 14 * S)] == [False, False, True]


def test_never() -> None:
    rule = Splitting(0, 0)
    assert not rule
    assert not any(rule.is_due(size, size * S) for size in (0, 1 << 40))
