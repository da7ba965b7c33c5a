"""What a match by shared memory goes through at its publisher's end: states, events, and which state follows.

Owns the table, and what is remembered of one match. The tables of the publisher that go with the states are
`bus.delivery.shm_sender`'s. (What the broker knows of a match is in `busd.core.match`.)
"""

from collections.abc import Mapping
from enum import Enum
from itertools import count

from bus.delivery.port import Owner, ReaderProcess
from bus.qos import History
from bus.wire import messages as m

__all__ = ["GATES", "STALE", "Gate", "GateEvent", "GateState", "MatchError"]

_keys = count(1)


class GateState(Enum):
    """Where a match stands for its publisher: whether its reader holds what is in the ring."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    NEW = "new"
    EXPECTED = "expected"
    """The broker made the match; its reader has not said yet where it tells what it has read."""
    ATTACHED = "attached"
    """It has."""
    UNSURE = "unsure"
    """It was expected by an earlier broker; the present one has not made the match yet."""
    READING_ON = "reading on"
    """It reads since an earlier broker; the present one has not made the match yet."""
    LEFT = "left"
    """The match is gone; its reader may still hold messages in the ring."""
    LOST = "lost"
    """The match is gone; its reader perhaps is not, and may read on until its process ends."""
    ENDED = "ended"
    """Nothing is held for it any more."""


class GateEvent(Enum):
    """What happens to it."""

    __hash__ = object.__hash__

    MATCH = "match"
    """The broker makes the match (Matched)."""
    ATTACH = "attach"
    """The reader says where it tells what it has read (Attached)."""
    DISCONNECT = "disconnect"
    """The broker is gone, or the connection to it."""
    UNMATCH = "unmatch"
    """The match ends, and its reader has left the ring, or will."""
    LOSE = "lose"
    """The match ends, and its reader was not heard of."""
    FORGET = "forget"
    """The reader holds nothing any more, or comes back in another match."""


_State, _Event = GateState, GateEvent

GATES: Mapping[GateState, Mapping[GateEvent, GateState]] = {
    _State.NEW: {_Event.MATCH: _State.EXPECTED},
    _State.EXPECTED: {
        _Event.ATTACH: _State.ATTACHED,
        _Event.DISCONNECT: _State.UNSURE,
        _Event.UNMATCH: _State.ENDED,
        _Event.LOSE: _State.ENDED,
    },
    _State.ATTACHED: {
        _Event.ATTACH: _State.ATTACHED,  # it was reading on, and now the present broker says so, too
        _Event.DISCONNECT: _State.READING_ON,
        _Event.UNMATCH: _State.LEFT,
        _Event.LOSE: _State.LOST,
    },
    _State.UNSURE: {
        _Event.MATCH: _State.EXPECTED,
        _Event.DISCONNECT: _State.UNSURE,
        _Event.LOSE: _State.ENDED,
    },
    _State.READING_ON: {
        _Event.MATCH: _State.ATTACHED,
        _Event.DISCONNECT: _State.READING_ON,
        _Event.UNMATCH: _State.LEFT,
        _Event.LOSE: _State.LOST,
    },
    _State.LEFT: {_Event.FORGET: _State.ENDED},
    _State.LOST: {_Event.FORGET: _State.ENDED},
    _State.ENDED: {},
}
"""What follows, by state and event; what is not in it must not happen."""

STALE = (GateState.UNSURE, GateState.READING_ON)
"""The states in which the present broker has not made the match."""


class MatchError(Exception):
    """Something happened to a match that can't happen in its state: a bug of this library."""


class Gate:
    """A match of the publisher `owner`, and what its reader holds. Nothing but `on` changes the state.

    Until it is ATTACHED it is only known that there will be a reader, and from which number on it reads.
    """

    __slots__ = ("_owner", "hold", "is_held", "key", "matched", "place", "state")

    def __init__(self, owner: Owner, matched: m.Matched, hold: int) -> None:
        self._owner = owner
        self.state = GateState.NEW
        self.key = next(_keys)
        self.hold = hold  # until it is attached, nothing from here on may be given up
        self.is_held = matched.qos.is_lossless  # not while its process is silent, nor where memory ends
        self.place: tuple[ReaderProcess, int] | None = None
        """Where the reader tells what it has read: the slot of its process. None until it is ATTACHED."""
        self.matched = matched

    @property
    def depth(self) -> int:
        """Records that must stay for it."""
        qos = self.matched.qos
        return qos.depth if qos.history is History.KEEP_LAST else 1

    def on(self, event: GateEvent) -> None:
        """`event` happens. Raises MatchError where it can't."""
        state = GATES[self.state].get(event)
        if state is None:
            raise MatchError(f"{self.describe()} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def describe(self) -> str:
        owner, other = self._owner, self.matched
        return (
            f"the match on '{owner.topic_name}' of publisher {owner._id} (here) "
            f"and subscription {other.other} ({other.node})"
        )
