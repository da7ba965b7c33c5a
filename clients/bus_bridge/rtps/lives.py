"""The states of a match between a reader and a writer, at each of its ends, as tables. Pure."""

from collections.abc import Mapping
from enum import Enum

__all__ = [
    "READER_TRANSITIONS",
    "WRITER_TRANSITIONS",
    "ReaderEvent",
    "ReaderState",
    "WriterEvent",
    "WriterState",
]


class WriterState(Enum):
    """The task of a writer for one far reader."""

    QUIET = "quiet"
    """The reader has acknowledged everything for it."""
    WAITING = "waiting"
    """Something is not acknowledged: heartbeats, less and less often."""
    REPAIRING = "repairing"
    """The reader has asked for samples, which are sent as soon as the last repair is some time ago."""


class WriterEvent(Enum):
    WRITE = "write"
    """A sample for the reader is written."""
    REQUEST = "request"
    """The reader asks for samples that it did not get."""
    REPAIR = "repair"
    """Everything that it asked for was sent once more."""
    CATCH_UP = "catch up"
    """It has acknowledged everything, or the samples that it lacks are no longer kept."""


WRITER_TRANSITIONS: Mapping[WriterState, Mapping[WriterEvent, WriterState]] = {
    WriterState.QUIET: {
        WriterEvent.WRITE: WriterState.WAITING,
        WriterEvent.REQUEST: WriterState.REPAIRING,
        WriterEvent.CATCH_UP: WriterState.QUIET,
    },
    WriterState.WAITING: {
        WriterEvent.WRITE: WriterState.WAITING,
        WriterEvent.REQUEST: WriterState.REPAIRING,
        WriterEvent.CATCH_UP: WriterState.QUIET,
    },
    WriterState.REPAIRING: {
        WriterEvent.WRITE: WriterState.REPAIRING,
        WriterEvent.REQUEST: WriterState.REPAIRING,
        WriterEvent.REPAIR: WriterState.WAITING,
        WriterEvent.CATCH_UP: WriterState.QUIET,
    },
}
"""The next state. An event that is missing in the row of a state must not happen in it. A match begins as
WAITING: the first heartbeat asks for an answer."""


class ReaderState(Enum):
    """What a reader does about one far writer."""

    JOINING = "joining"
    """No heartbeat has come: the reader asks for one."""
    FOLLOWING = "following"
    """As far as is known, nothing is missing."""
    ASKING = "asking"
    """Something is missing: the reader asks for it, less and less often."""


class ReaderEvent(Enum):
    MISS = "miss"
    """A number, or a fragment, is missing."""
    FILL = "fill"
    """Nothing is missing any more."""


READER_TRANSITIONS: Mapping[ReaderState, Mapping[ReaderEvent, ReaderState]] = {
    ReaderState.JOINING: {
        ReaderEvent.MISS: ReaderState.ASKING,
        ReaderEvent.FILL: ReaderState.FOLLOWING,
    },
    ReaderState.FOLLOWING: {
        ReaderEvent.MISS: ReaderState.ASKING,
        ReaderEvent.FILL: ReaderState.FOLLOWING,
    },
    ReaderState.ASKING: {
        ReaderEvent.MISS: ReaderState.ASKING,
        ReaderEvent.FILL: ReaderState.FOLLOWING,
    },
}
