"""The two tables of a match: each state can be reached, and left for the quiet one."""

from bus_bridge.rtps.lives import (
    READER_TRANSITIONS,
    WRITER_TRANSITIONS,
    ReaderEvent,
    ReaderState,
    WriterEvent,
    WriterState,
)
from transitions import paths


def test_each_state_is_reached() -> None:
    assert {*paths(WRITER_TRANSITIONS, WriterState.WAITING)} == {*WriterState} == {*WRITER_TRANSITIONS}
    assert {*paths(READER_TRANSITIONS, ReaderState.JOINING)} == {*ReaderState} == {*READER_TRANSITIONS}


def test_each_state_has_a_way_to_rest() -> None:
    assert all(row[WriterEvent.CATCH_UP] is WriterState.QUIET for row in WRITER_TRANSITIONS.values())
    assert all(row[ReaderEvent.FILL] is ReaderState.FOLLOWING for row in READER_TRANSITIONS.values())


def test_only_a_request_is_repaired() -> None:
    repairing = [state for state, row in WRITER_TRANSITIONS.items() if WriterEvent.REPAIR in row]
    assert repairing == [WriterState.REPAIRING]
