"""bus_launch.launch.actions.process_state: every cell of the table, and the states that can be reached."""

from itertools import product

import pytest

from bus_launch.launch.actions.process_state import (
    PROCESSES,
    ProcessError,
    ProcessEvent,
    ProcessState,
    next_state,
)
from rows import for_each
from transitions import paths

START, EXIT, END, RESTART, GIVE_UP = ProcessEvent
STARTING, UNWANTED, RUNNING, ENDING, WAITING, ENDED = ProcessState
# For each state, the next state after START, EXIT, END, RESTART, GIVE_UP.
CELLS = {
    STARTING: (RUNNING, WAITING, UNWANTED, None, None),
    UNWANTED: (ENDING, ENDED, UNWANTED, None, None),
    RUNNING: (None, WAITING, ENDING, None, None),
    ENDING: (None, ENDED, ENDING, None, None),
    WAITING: (None, None, ENDED, STARTING, ENDED),
    ENDED: (None, None, ENDED, None, None),
}


@for_each(("state", "event"), list(product(ProcessState, ProcessEvent)))
def test_every_cell(state: ProcessState, event: ProcessEvent) -> None:
    expected = CELLS[state][list(ProcessEvent).index(event)]
    if expected is not None:
        assert next_state(state, event) is expected
        return
    with pytest.raises(ProcessError) as caught:
        next_state(state, event)
    assert str(caught.value) == f"the process is {state.value!r}: {event.value!r} can't happen to it"


def test_every_state_has_a_row_and_can_be_reached_and_left() -> None:
    assert {*PROCESSES} == {*ProcessState} == {*paths(PROCESSES, STARTING)}
    for state in ProcessState:
        assert ENDED in paths(PROCESSES, state)


def test_a_process_can_be_told_to_end_in_every_state() -> None:
    """A launch may shut down at any moment, and then tells all processes."""
    assert all(END in row for row in PROCESSES.values())
