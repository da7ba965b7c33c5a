"""The states of a recording: every cell of their table."""

import pytest

from bus_bag.life import LifeError
from bus_bag.record.state import (
    TRANSITIONS,
    RecordingEvent,
    RecordingLife,
    RecordingState,
)
from rows import for_each

BEGIN, STOP, FAIL, CLOSE = (
    RecordingEvent.BEGIN,
    RecordingEvent.STOP,
    RecordingEvent.FAIL,
    RecordingEvent.CLOSE,
)
WAYS = {
    RecordingState.STARTING: [],
    RecordingState.RECORDING: [BEGIN],
    RecordingState.FAILING: [BEGIN, FAIL],
    RecordingState.FINISHING: [BEGIN, STOP],
    RecordingState.HURRYING: [BEGIN, STOP, STOP],
    RecordingState.CLOSED: [STOP, CLOSE],
}


def life_in(state: RecordingState) -> RecordingLife:
    life = RecordingLife()
    for event in WAYS[state]:
        life.on(event)
    assert life.state is state
    return life


@for_each(("state", "event"), [(state, event) for state in RecordingState for event in RecordingEvent])
def test_every_cell(state: RecordingState, event: RecordingEvent) -> None:
    life = life_in(state)
    following = TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(LifeError, match=f"RecordingState: '{event.value}' .* '{state.value}'"):
            life.on(event)
        assert life.state is state
    else:
        assert life.on(event) is life.state is following


def test_the_first_request_to_stop_gives_up_nothing_and_the_second_what_waits() -> None:
    for ways in ([STOP], [BEGIN, STOP], [BEGIN, FAIL, STOP], [BEGIN, STOP, FAIL]):
        life = RecordingLife()
        for event in ways:
            life.on(event)
        assert life.state is RecordingState.FINISHING and life.is_ending
        assert life.on(STOP) is RecordingState.HURRYING


def test_a_signal_or_a_failure_after_the_end_changes_nothing() -> None:
    life = life_in(RecordingState.CLOSED)
    assert life.on(STOP) is life.on(FAIL) is RecordingState.CLOSED


def test_ending() -> None:
    going_on = {state for state in RecordingState if not life_in(state).is_ending}
    assert going_on == {RecordingState.STARTING, RecordingState.RECORDING}
