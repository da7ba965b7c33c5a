"""The life of a stream: the states of its two halves, the events that change them, and which state follows.

A stream can end in each direction by itself, so reading and writing have a table each. Pure: what a stream
does when it enters a state (watch the socket, shut a half of it) is in `bus.transport.stream`.
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
    """What the other side can still send, and what its end means."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    OPEN = "open"
    """It may send. If it ends, the connection is lost."""
    HUNG_UP = "hung up"
    """It has gone. The bytes that it sent before are read to the end; then the connection is lost."""
    LINGERING = "lingering"
    """It may send. If it ends, only this half ends: it may still take bytes."""
    LINGERING_HUNG_UP = "lingering, hung up"
    """It has gone, and the end of what it sent ends only this half."""
    SHUT = "shut"
    """This side has shut the half. Bytes that came before are read to the end, even while reading is held."""
    ENDED = "ended"
    """Everything was read, the connection goes on."""
    CLOSED = "closed"
    """The socket is closed."""


class ReadEvent(Enum):
    """What happens to the reading half."""

    __hash__ = object.__hash__

    LINGER = "linger"
    """The owner wants to go on when the other side sends no more."""
    HANG_UP = "hang up"
    """The kernel reports that the other side has gone."""
    SHUT = "shut"
    """The owner wants no more than what has come by now."""
    END = "end"
    """The last byte was read."""
    CLOSE = "close"
    """The owner closes the stream, or the connection is lost."""


class WriteState(Enum):
    """Whether the socket takes bytes, and if not, what the stream waits for."""

    __hash__ = object.__hash__

    OPEN = "open"
    """It takes bytes, as far as is known."""
    BLOCKED = "blocked"
    """It did not take everything, or this turn has sent enough: wait until the socket is writable."""
    DEFERRED = "deferred"
    """It is writable, but the owner has put the write off (`may_write`): wait for the owner."""
    PAUSED = "paused"
    """The user has too many descriptors in flight, and the kernel reports no end of that: wait a moment."""
    FINISHING = "finishing"
    """Blocked, and nothing follows the frame that has begun."""
    ENDED = "ended"
    """Nothing is sent any more: the owner has finished, or the other side takes nothing."""
    CLOSED = "closed"
    """The socket is closed."""


class WriteEvent(Enum):
    """What happens to the writing half."""

    __hash__ = object.__hash__

    BLOCK = "block"
    """The socket did not take everything, or the stream stops until the event loop's next turn."""
    DEFER = "defer"
    """The socket is writable, and the owner says: not now."""
    PAUSE = "pause"
    """The kernel refuses a frame for its descriptors (ETOOMANYREFS). Nothing of the frame was sent."""
    RETRY = "retry"
    """The moment after a pause has passed."""
    DRAIN = "drain"
    """The rest of what the socket did not take is sent."""
    FINISH = "finish"
    """The owner sends no more, and a frame may have begun."""
    END = "end"
    """The owner sends no more, and no frame has begun; or the other side takes nothing any more."""
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
"""What follows in the reading half, by state and event; what is not in it must not happen."""

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
"""No further bytes will come, those that have come are yet to be read."""
READ_OVER = (ReadState.ENDED, ReadState.CLOSED)
"""Nothing is read any more."""
WRITE_OVER = (WriteState.ENDED, WriteState.CLOSED)
"""Nothing is sent any more."""


class StreamError(Exception):
    """Something happened to a stream that can't happen in its state: a bug of this library."""


_S = TypeVar("_S", bound=Enum)
_E = TypeVar("_E", bound=Enum)


def follow(table: Mapping[_S, Mapping[_E, _S]], state: _S, event: _E) -> _S:
    """The state after `event`. Raises StreamError where that can't happen in `state`."""
    after = table[state].get(event)
    if after is None:
        raise StreamError(f"a stream that is {state.value!r}: {event.value!r} can't happen to it")
    return after
