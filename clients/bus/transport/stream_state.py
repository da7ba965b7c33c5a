"""The states of a stream's two halves, the events that change them, and the transitions.

A stream can end in each direction separately, so reading and writing have a table each. Pure:
`bus.transport.stream` acts on the states (watches the socket, shuts a half of it).
"""

from collections.abc import Mapping
from enum import Enum
from typing import TypeVar

__all__ = [
    "HUNG_UP",
    "READS",
    "READ_OVER",
    "WRITES",
    "WRITE_OVER",
    "ReadEvent",
    "ReadState",
    "StreamError",
    "WriteEvent",
    "WriteState",
    "follow",
]


class ReadState(Enum):
    """Whether the other side can still send, and the effect of its end."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    OPEN = "open"
    """The other side may send. If it ends, the connection is lost."""
    HUNG_UP = "hung up"
    """The other side has gone. Its earlier bytes are read to the end; then the connection is lost."""
    LINGERING = "lingering"
    """The other side may send. If it ends, only this half ends: it may still accept bytes."""
    LINGERING_HUNG_UP = "lingering, hung up"
    """The other side has gone, and the end of its data ends only this half."""
    SHUT = "shut"
    """This side has shut the half. Earlier bytes are read to the end, even while reading is held."""
    ENDED = "ended"
    """Everything was read, and the connection continues."""
    CLOSED = "closed"
    """The socket is closed."""


class ReadEvent(Enum):
    """Events of the reading half."""

    __hash__ = object.__hash__

    LINGER = "linger"
    """The owner wants to continue when the other side stops sending."""
    HANG_UP = "hang up"
    """The kernel reports that the other side has gone."""
    SHUT = "shut"
    """The owner wants only data that has already come."""
    END = "end"
    """The last byte was read."""
    CLOSE = "close"
    """The owner closes the stream, or the connection is lost."""


class WriteState(Enum):
    """Whether the socket accepts bytes; if not, the event that the stream waits for."""

    __hash__ = object.__hash__

    OPEN = "open"
    """The socket accepts bytes, as far as known."""
    BLOCKED = "blocked"
    """The socket did not accept everything, or this turn has sent enough: wait until it is writable."""
    DEFERRED = "deferred"
    """The socket is writable, but the owner has deferred the write (`may_write`): wait for the owner."""
    PAUSED = "paused"
    """The user has too many descriptors in flight, and no event reports the end of that: wait a moment."""
    FINISHING = "finishing"
    """Blocked, and nothing follows the frame that has begun."""
    ENDED = "ended"
    """Nothing is sent any more: the owner has finished, or the other side accepts nothing."""
    CLOSED = "closed"
    """The socket is closed."""


class WriteEvent(Enum):
    """Events of the writing half."""

    __hash__ = object.__hash__

    BLOCK = "block"
    """The socket did not accept everything, or the stream stops until the event loop's next turn."""
    DEFER = "defer"
    """The socket is writable, and the owner defers the write."""
    PAUSE = "pause"
    """The kernel refuses a frame for its descriptors (ETOOMANYREFS). Nothing of the frame was sent."""
    RETRY = "retry"
    """A pause is over."""
    DRAIN = "drain"
    """The rest that the socket had not accepted is sent."""
    FINISH = "finish"
    """The owner sends no more, and a frame may have begun."""
    END = "end"
    """The owner sends no more, and no frame has begun; or the other side accepts nothing any more."""
    CLOSE = "close"
    """The owner closes the stream, or the connection is lost."""


READS: Mapping[ReadState, Mapping[ReadEvent, ReadState]] = {
    ReadState.OPEN: {
        ReadEvent.LINGER: ReadState.LINGERING,
        ReadEvent.HANG_UP: ReadState.HUNG_UP,
        ReadEvent.SHUT: ReadState.SHUT,
        ReadEvent.END: ReadState.CLOSED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.HUNG_UP: {
        ReadEvent.LINGER: ReadState.LINGERING_HUNG_UP,
        ReadEvent.HANG_UP: ReadState.HUNG_UP,
        ReadEvent.SHUT: ReadState.SHUT,
        ReadEvent.END: ReadState.CLOSED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.LINGERING: {
        ReadEvent.LINGER: ReadState.LINGERING,
        ReadEvent.HANG_UP: ReadState.LINGERING_HUNG_UP,
        ReadEvent.SHUT: ReadState.SHUT,
        ReadEvent.END: ReadState.ENDED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.LINGERING_HUNG_UP: {
        ReadEvent.LINGER: ReadState.LINGERING_HUNG_UP,
        ReadEvent.HANG_UP: ReadState.LINGERING_HUNG_UP,
        ReadEvent.SHUT: ReadState.SHUT,
        ReadEvent.END: ReadState.ENDED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.SHUT: {
        ReadEvent.LINGER: ReadState.SHUT,
        ReadEvent.HANG_UP: ReadState.SHUT,
        ReadEvent.SHUT: ReadState.SHUT,
        ReadEvent.END: ReadState.ENDED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.ENDED: {
        ReadEvent.LINGER: ReadState.ENDED,
        ReadEvent.HANG_UP: ReadState.ENDED,
        ReadEvent.SHUT: ReadState.ENDED,
        ReadEvent.CLOSE: ReadState.CLOSED,
    },
    ReadState.CLOSED: {ReadEvent.LINGER: ReadState.CLOSED, ReadEvent.SHUT: ReadState.CLOSED},
}
"""The next state of the reading half, by state and event. Any other event in a state is an error."""

WRITES: Mapping[WriteState, Mapping[WriteEvent, WriteState]] = {
    WriteState.OPEN: {
        WriteEvent.BLOCK: WriteState.BLOCKED,
        WriteEvent.PAUSE: WriteState.PAUSED,
        WriteEvent.END: WriteState.ENDED,
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.BLOCKED: {
        WriteEvent.BLOCK: WriteState.BLOCKED,
        WriteEvent.DEFER: WriteState.DEFERRED,
        WriteEvent.PAUSE: WriteState.PAUSED,
        WriteEvent.DRAIN: WriteState.OPEN,
        WriteEvent.FINISH: WriteState.FINISHING,
        WriteEvent.END: WriteState.ENDED,
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.DEFERRED: {
        WriteEvent.BLOCK: WriteState.BLOCKED,
        WriteEvent.PAUSE: WriteState.PAUSED,
        WriteEvent.DRAIN: WriteState.OPEN,
        WriteEvent.FINISH: WriteState.FINISHING,
        WriteEvent.END: WriteState.ENDED,
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.PAUSED: {
        WriteEvent.RETRY: WriteState.BLOCKED,
        WriteEvent.FINISH: WriteState.ENDED,  # nothing of the frame was sent
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.FINISHING: {
        WriteEvent.BLOCK: WriteState.FINISHING,
        WriteEvent.PAUSE: WriteState.ENDED,
        WriteEvent.DRAIN: WriteState.ENDED,
        WriteEvent.FINISH: WriteState.FINISHING,
        WriteEvent.END: WriteState.ENDED,
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.ENDED: {
        WriteEvent.RETRY: WriteState.ENDED,
        WriteEvent.FINISH: WriteState.ENDED,
        WriteEvent.END: WriteState.ENDED,
        WriteEvent.CLOSE: WriteState.CLOSED,
    },
    WriteState.CLOSED: {
        WriteEvent.RETRY: WriteState.CLOSED,
        WriteEvent.FINISH: WriteState.CLOSED,
        WriteEvent.END: WriteState.CLOSED,
    },
}
"""The same for the writing half."""

HUNG_UP = (ReadState.HUNG_UP, ReadState.LINGERING_HUNG_UP, ReadState.SHUT)
"""No further bytes will come, and received bytes are still unread."""
READ_OVER = (ReadState.ENDED, ReadState.CLOSED)
"""Nothing is read any more."""
WRITE_OVER = (WriteState.ENDED, WriteState.CLOSED)
"""Nothing is sent any more."""


class StreamError(Exception):
    """An event of a stream that is impossible in its state: a bug of this library."""


_S = TypeVar("_S", bound=Enum)
_E = TypeVar("_E", bound=Enum)


def follow(table: Mapping[_S, Mapping[_E, _S]], state: _S, event: _E) -> _S:
    """The state after `event`. Raises StreamError if the event is impossible in `state`."""
    after = table[state].get(event)
    if after is None:
        raise StreamError(f"a stream that is {state.value!r}: {event.value!r} can't happen to it")
    return after
