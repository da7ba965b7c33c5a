"""bus_launch.launch_testing.ready: when tests may begin, also of a description with parameters."""

from typing import Any

from bus_launch.launch_testing import ReadyAggregator, parametrize, ready_to_test_action_timeout


def test_parametrize() -> None:
    @parametrize("a, b", [(1, 2), (3, 4)])
    @ready_to_test_action_timeout(5)
    def describe(a: int, b: int, other: str) -> Any:
        return a, b, other

    rows = list(describe())
    assert [given for _, given in rows] == [{"a": 1, "b": 2}, {"a": 3, "b": 4}]
    assert [function(other="x") for function, _ in rows] == [(1, 2, "x"), (3, 4, "x")]
    assert rows[0][0].__ready_to_test_action_timeout__ == 5  # type: ignore[attr-defined]

    @parametrize("a", [1, (2,)])
    def one(a: int) -> int:
        return a

    assert [function() for function, _ in one()] == [1, 2]


def test_ready_after_several_calls() -> None:
    calls: list[int] = []
    aggregator = ReadyAggregator(lambda: calls.append(1), 2)
    aggregator.ready_fn()
    assert calls == []
    aggregator.ready_fn()
    aggregator.ready_fn()
    assert calls == [1]
