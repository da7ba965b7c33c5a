"""The goals that a cancel request means, the results that expire, and the bounds of a server's goals."""

import pytest

from bus_actions.goal_state import GoalEvent, GoalStatus
from bus_actions.goal_table import (
    ANY_GOAL,
    MOST_ACTIVE,
    MOST_ENDED,
    MOST_SHOWN,
    CancelCode,
    Goal,
    GoalExists,
    GoalTable,
    TooManyGoals,
)
from rows import for_each

A, X, C, S, N, B = (
    GoalStatus.ACCEPTED,
    GoalStatus.EXECUTING,
    GoalStatus.CANCELING,
    GoalStatus.SUCCEEDED,
    GoalStatus.CANCELED,
    GoalStatus.ABORTED,
)


def goal_id(number: int) -> bytes:
    return number.to_bytes(16, "big")


def table_of(*statuses: GoalStatus, keep_ns: int = 100) -> tuple[GoalTable, list[Goal]]:
    """A table with goals accepted at 1, 2, 3 ... All of them get to their states at 50."""
    table = GoalTable(keep_ns)
    goals = [table.accept(goal_id(number), number) for number in range(1, len(statuses) + 1)]
    ways = {
        A: (),
        X: (GoalEvent.EXECUTE,),
        C: (GoalEvent.CANCEL_GOAL,),
        S: (GoalEvent.EXECUTE, GoalEvent.SUCCEED),
        N: (GoalEvent.CANCEL_GOAL, GoalEvent.CANCELED),
        B: (GoalEvent.EXECUTE, GoalEvent.ABORT),
    }
    for goal, status in zip(goals, statuses, strict=True):
        for event in ways[status]:
            table.advance(goal, event, 50)
        assert goal.status is status
    return table, goals


def test_a_goal_comes_once() -> None:
    table, _ = table_of(A, S)
    for number in (1, 2):
        with pytest.raises(GoalExists):
            table.accept(goal_id(number), 60)


@for_each(
    ("number", "stamp_ns", "meant"),
    [
        (0, 0, [1, 2]),  # all goals
        (1, 0, [1]),
        (0, 1, [1]),  # all goals accepted until then
        (2, 1, [1, 2]),  # this goal and all accepted until then
        (0, 6, [1, 2]),
    ],
)
def test_whom_a_request_means(number: int, stamp_ns: int, meant: list[int]) -> None:
    table, _ = table_of(A, X, C, S, N, B)
    found = table.canceled_by(goal_id(number), stamp_ns)
    assert found.code is CancelCode.NONE
    assert [goal.id for goal in found.goals] == [goal_id(one) for one in meant]


def test_whom_nobody_can_cancel() -> None:
    table, _ = table_of(A, X, C, S, N, B)
    codes = {number: table.canceled_by(goal_id(number), 0) for number in (3, 4, 5, 6, 7)}
    assert codes == {
        **dict.fromkeys((3, 4, 5, 6), (CancelCode.GOAL_TERMINATED, ())),
        7: (CancelCode.UNKNOWN_GOAL_ID, ()),
    }
    assert GoalTable(0).canceled_by(ANY_GOAL, 0) == (CancelCode.NONE, ())


def test_results_expire() -> None:
    table, goals = table_of(A, S, B)
    assert table.next_expiry_ns() == 150
    assert table.expire(149) == []
    assert table.expire(150) == goals[1:]
    assert table.next_expiry_ns() is None
    assert table.active() == goals[:1]
    assert table.find(goal_id(2)) is None

    for_ever, _ = table_of(S, keep_ns=-1)
    assert (for_ever.next_expiry_ns(), for_ever.expire(10**18)) == (None, [])


def test_what_bounds_it() -> None:
    table = GoalTable(-1)
    goals = [table.accept(goal_id(number), number) for number in range(1, MOST_ACTIVE + 1)]
    with pytest.raises(TooManyGoals):
        table.accept(goal_id(MOST_ACTIVE + 1), 0)
    for goal in goals:
        table.advance(goal, GoalEvent.EXECUTE, 1)
        table.advance(goal, GoalEvent.SUCCEED, 1)
    late = table.accept(goal_id(MOST_ACTIVE + 1), MOST_ACTIVE + 1)
    assert table.shown() == [*goals[-MOST_SHOWN:], late]
    table.advance(late, GoalEvent.CANCEL_GOAL, 2)
    table.advance(late, GoalEvent.CANCELED, 2)
    assert table.expire(3) == goals[: MOST_ACTIVE + 1 - MOST_ENDED]
