"""bus.transport.stream_state: every cell of both tables, and the events that lead from state to state."""

from typing import Any

import pytest

from bus.transport.stream_state import (
    HUNG_UP,
    READ_OVER,
    READS,
    WRITE_OVER,
    WRITES,
    ReadEvent,
    ReadState,
    StreamError,
    WriteEvent,
    WriteState,
    follow,
)
from rows import for_each
from transitions import paths

READ_CELLS = """
                    | linger             | hang up            | shut   | end    | close
 open               | lingering          | hung up            | shut   | closed | closed
 hung up            | lingering, hung up | hung up            | shut   | closed | closed
 lingering          | lingering          | lingering, hung up | shut   | ended  | closed
 lingering, hung up | lingering, hung up | lingering, hung up | shut   | ended  | closed
 shut               | shut               | shut               | shut   | ended  | closed
 ended              | ended              | ended              | ended  |        | closed
 closed             | closed             |                    | closed |        |
"""
WRITE_CELLS = """
           | block     | defer    | pause  | retry   | drain | finish    | end    | close
 open      | blocked   |          | paused |         |       |           | ended  | closed
 blocked   | blocked   | deferred | paused |         | open  | finishing | ended  | closed
 deferred  | blocked   |          | paused |         | open  | finishing | ended  | closed
 paused    |           |          |        | blocked |       | ended     |        | closed
 finishing | finishing |          | ended  |         | ended | finishing | ended  | closed
 ended     |           |          |        | ended   |       | ended     | ended  | closed
 closed    |           |          |        | closed  |       | closed    | closed |
"""
"""Rows are states, columns are events. A cell has the next state; an empty cell means a bug."""


def cells(text: str, states: Any, events: Any) -> list[tuple[Any, Any, Any]]:
    head, *rows = [[cell.strip() for cell in line.split("|")] for line in text.strip("\n").splitlines()]
    columns = [events(name) for name in head[1:]]
    assert [states(row[0]) for row in rows] == [*states]
    assert columns == [*events]
    return [
        (states(name), event, states(after) if after else None)
        for name, *afters in rows
        for event, after in zip(columns, afters, strict=True)
    ]


HALVES: dict[Any, tuple[Any, Any]] = {
    ReadState: (READS, ReadState.OPEN),
    WriteState: (WRITES, WriteState.OPEN),
}
CELLS = [*cells(READ_CELLS, ReadState, ReadEvent), *cells(WRITE_CELLS, WriteState, WriteEvent)]


@for_each(("state", "event", "after"), CELLS)
def test_every_cell(state: Any, event: Any, after: Any) -> None:
    table, reached = HALVES[type(state)]
    for one in paths(table, reached)[state]:
        reached = follow(table, reached, one)
    assert reached is state
    if after is not None:
        assert follow(table, reached, event) is after
        return
    with pytest.raises(StreamError) as caught:
        follow(table, reached, event)
    assert str(caught.value) == f"a stream that is {state.value!r}: {event.value!r} can't happen to it"


@pytest.mark.parametrize("states", HALVES)
def test_every_state_has_a_row_and_can_be_reached_and_left(states: Any) -> None:
    table, first = HALVES[states]
    assert {*paths(table, first)} == {*states} == {*table}
    for state in states:
        assert states.CLOSED in paths(table, state)


def test_what_is_over_does_not_begin_again() -> None:
    for state in READ_OVER:
        assert {*paths(READS, state)} <= {*READ_OVER}
    for end in WRITE_OVER:
        assert {*paths(WRITES, end)} <= {*WRITE_OVER}


def test_who_has_hung_up_does_not_come_back() -> None:
    for state in HUNG_UP:
        assert {*paths(READS, state)} <= {*HUNG_UP, *READ_OVER}
