"""The life of a recording as a table: its states, the events, and the next state for each. Pure.

A recording can end in three ways: on request, because it can't continue, and at once. Only the last one drops
messages. All end with CLOSED. A pause is not a state here, because each state can be paused, even at the end.
"""

from collections.abc import Mapping
from enum import Enum

from bus_bag.life import Life

__all__ = ["TRANSITIONS", "RecordingEvent", "RecordingLife", "RecordingState"]


class RecordingState(Enum):
    """States of a recording."""

    __hash__ = object.__hash__  # the one of Enum is a Python function, which is slower

    STARTING = "starting"
    """It waits for the simulated time, if it needs that, and for the first graph."""
    RECORDING = "recording"
    """It has subscribed to the topics of the first graph, and follows the graph."""
    FAILING = "failing"
    """It can't continue. It takes arrived messages and writes as much as possible."""
    FINISHING = "finishing"
    """It was asked to end. It takes arrived messages and writes all of them."""
    HURRYING = "hurrying"
    """It was asked a second time: it drops unwritten messages."""
    CLOSED = "closed"


class RecordingEvent(Enum):
    """Events that change the state."""

    __hash__ = object.__hash__

    BEGIN = "begin"
    """The topics of the first graph are subscribed."""
    STOP = "stop"
    """Ctrl-C, a signal or a program asks for the end."""
    FAIL = "fail"
    """Nothing more can be written, or one of its tasks has failed."""
    CLOSE = "close"
    """The bag is closed."""


TRANSITIONS: Mapping[RecordingState, Mapping[RecordingEvent, RecordingState]] = {
    RecordingState.STARTING: {
        RecordingEvent.BEGIN: RecordingState.RECORDING,
        RecordingEvent.STOP: RecordingState.FINISHING,
        RecordingEvent.FAIL: RecordingState.FAILING,
        RecordingEvent.CLOSE: RecordingState.CLOSED,  # it was cancelled
    },
    RecordingState.RECORDING: {
        RecordingEvent.STOP: RecordingState.FINISHING,
        RecordingEvent.FAIL: RecordingState.FAILING,
        RecordingEvent.CLOSE: RecordingState.CLOSED,  # it was cancelled
    },
    RecordingState.FAILING: {
        RecordingEvent.STOP: RecordingState.FINISHING,  # the first Ctrl-C drops no message
        RecordingEvent.FAIL: RecordingState.FAILING,
        RecordingEvent.CLOSE: RecordingState.CLOSED,
    },
    RecordingState.FINISHING: {
        RecordingEvent.STOP: RecordingState.HURRYING,
        RecordingEvent.FAIL: RecordingState.FINISHING,
        RecordingEvent.CLOSE: RecordingState.CLOSED,
    },
    RecordingState.HURRYING: {
        RecordingEvent.STOP: RecordingState.HURRYING,
        RecordingEvent.FAIL: RecordingState.HURRYING,
        RecordingEvent.CLOSE: RecordingState.CLOSED,
    },
    RecordingState.CLOSED: {
        # A signal, or the last report of the writing thread, may still arrive.
        RecordingEvent.STOP: RecordingState.CLOSED,
        RecordingEvent.FAIL: RecordingState.CLOSED,
    },
}
"""The next state, by state and event. An event that is missing must not happen."""


class RecordingLife(Life[RecordingState, RecordingEvent]):
    """The state of one recording."""

    def __init__(self) -> None:
        super().__init__(TRANSITIONS, RecordingState.STARTING)

    @property
    def is_ending(self) -> bool:
        """Whether it wants no further topics, and lets no publisher wait any more."""
        return self.state is not RecordingState.STARTING and self.state is not RecordingState.RECORDING
