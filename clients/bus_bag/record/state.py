"""The life of a recording as a table: its states, the events, and which state follows. Pure.

A recording can end in three ways: on request, because it can't go on, and at once. Only the last gives up
messages. All end with CLOSED. Whether a recording is paused is no state here: it can be paused in each of
them, also while it ends.
"""

from collections.abc import Mapping
from enum import Enum

from bus_bag.life import Life

__all__ = ["TRANSITIONS", "RecordingEvent", "RecordingLife", "RecordingState"]


class RecordingState(Enum):
    """Where a recording stands."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    STARTING = "starting"
    """It waits for the simulated time, if it needs that, and for the first graph."""
    RECORDING = "recording"
    """It has subscribed to the topics of the first graph, and follows the graph."""
    FAILING = "failing"
    """It can't go on. It takes what has come and writes what can be written."""
    FINISHING = "finishing"
    """It was asked to end. It takes what has come and writes all of it."""
    HURRYING = "hurrying"
    """It was asked a second time: it gives up what is not yet written."""
    CLOSED = "closed"


class RecordingEvent(Enum):
    """What can happen to it."""

    __hash__ = object.__hash__

    BEGIN = "begin"
    """The topics of the first graph are subscribed to."""
    STOP = "stop"
    """Somebody asks it to end: Ctrl-C, a signal, or a program."""
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
        RecordingEvent.STOP: RecordingState.FINISHING,  # the first Ctrl-C gives up nothing
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
        # A signal, or the last word of the writing thread, may still be on its way.
        RecordingEvent.STOP: RecordingState.CLOSED,
        RecordingEvent.FAIL: RecordingState.CLOSED,
    },
}
"""What follows, by state and event; what is not in it must not happen."""


class RecordingLife(Life[RecordingState, RecordingEvent]):
    """The state of one recording."""

    def __init__(self) -> None:
        super().__init__(TRANSITIONS, RecordingState.STARTING)

    @property
    def is_ending(self) -> bool:
        """Whether no further topics are wanted, and no publisher is made to wait any more."""
        return self.state is not RecordingState.STARTING and self.state is not RecordingState.RECORDING
