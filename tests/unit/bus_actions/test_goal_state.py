"""Each cell of the table of a goal's states, compared with genuine rclpy's; and the page that draws the
table.
"""

from pathlib import Path

import pytest

from bus_actions.goal_state import TRANSITIONS, GoalEvent, GoalStatus, InvalidTransition, next_status

A, X, C, S, N, B = (
    GoalStatus.ACCEPTED,
    GoalStatus.EXECUTING,
    GoalStatus.CANCELING,
    GoalStatus.SUCCEEDED,
    GoalStatus.CANCELED,
    GoalStatus.ABORTED,
)
# From genuine rclpy. For each state, the next state after EXECUTE, CANCEL_GOAL, SUCCEED, ABORT, CANCELED.
CELLS = {
    GoalStatus.UNKNOWN: (None, None, None, None, None),
    A: (X, C, None, None, None),
    X: (None, C, S, B, None),
    C: (None, None, S, B, N),
    S: (None, None, None, None, None),
    N: (None, None, None, None, None),
    B: (None, None, None, None, None),
}


def test_every_cell_of_the_table() -> None:
    for status in GoalStatus:
        for event, expected in zip(GoalEvent, CELLS[status], strict=True):
            if expected is not None:
                assert next_status(status, event) is expected, (status, event)
                continue
            with pytest.raises(InvalidTransition) as refused:
                next_status(status, event)
            assert str(refused.value) == (
                f"goal_handle attempted invalid transition from state {status.name} with event {event.name}"
            )


def test_the_page_draws_it() -> None:
    page = (Path(__file__).parents[3] / "docs" / "actions.md").read_text()
    for status, row in TRANSITIONS.items():
        cells = [row[event].name if event in row else "" for event in GoalEvent]
        assert (
            f"| {status.name} | {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |") in page
        )
    assert f"| state | {' | '.join(event.name for event in GoalEvent)} |" in page


def test_what_is_active_and_what_is_an_end() -> None:
    assert [status for status in GoalStatus if status.is_active] == [A, X, C]
    assert [status for status in GoalStatus if status.is_end] == [S, N, B]
