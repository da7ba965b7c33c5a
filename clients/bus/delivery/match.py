"""The states of a match by shared memory at each of its ends: states, events, transitions.

Owns the two tables, and the data of one match: a Gate at the publisher's end, a Feed at the subscription's
end (its half in the native reader is `struct feed`). `bus.delivery.shm_sender` and `shm_receiver` act on the
states. (The broker's states of a match are in `busd.core.match`, its data in `busd.core.entities`.)
"""

from collections.abc import Mapping
from enum import Enum
from itertools import count
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from bus.base.descriptor import Descriptor
from bus.delivery.port import Owner, ReaderProcess
from bus.qos import History
from bus.wire import messages as m

if TYPE_CHECKING:  # programs that only publish don't need it
    from bus.delivery.sequence import PublisherProxy

__all__ = [
    "FEEDS",
    "GATES",
    "STALE",
    "Feed",
    "FeedEvent",
    "FeedState",
    "Gate",
    "GateEvent",
    "GateState",
    "MatchError",
]

_keys = count(1)


class GateState(Enum):
    """The state of a match for its publisher: whether its reader holds records in the ring."""

    __hash__ = object.__hash__  # Enum's own is a call in Python

    NEW = "new"
    EXPECTED = "expected"
    """The broker made the match; its reader has not named its slot yet (Attached)."""
    ATTACHED = "attached"
    """Its reader has named its slot, in which it shows its position."""
    UNSURE = "unsure"
    """An earlier broker expected the reader; the present one has not made the match yet."""
    READING_ON = "reading on"
    """The reader has read since an earlier broker; the present one has not made the match yet."""
    LEFT = "left"
    """The match is gone; its reader may still hold messages in the ring."""
    LOST = "lost"
    """The match is gone; its reader may still exist, and read until its process ends."""
    ENDED = "ended"
    """The ring keeps nothing for the match any more."""


class GateEvent(Enum):
    """Events of a gate."""

    __hash__ = object.__hash__

    MATCH = "match"
    """The broker makes the match (Matched)."""
    ATTACH = "attach"
    """The reader names its slot (Attached)."""
    DISCONNECT = "disconnect"
    """The broker is gone, or the connection to it."""
    UNMATCH = "unmatch"
    """The match ends, and its reader has left the ring, or will."""
    LOSE = "lose"
    """The match ends without a sign of its reader."""
    FORGET = "forget"
    """The reader holds nothing any more, or comes back in another match."""


class FeedState(Enum):
    """The state of a match for its subscription: its source of messages, and whether more will come."""

    __hash__ = object.__hash__

    NEW = "new"
    ATTACHED = "attached"
    """The subscription reads the publisher's ring."""
    READING_ON = "reading on"
    """It has read since an earlier broker; the present one has not made the match yet."""
    FINISHING = "finishing"
    """The publisher has gone: the subscription still takes the samples in its ring."""
    ENDED = "ended"
    """The subscription has left the ring."""


class FeedEvent(Enum):
    """Events of a feed."""

    __hash__ = object.__hash__

    ATTACH = "attach"
    """The broker makes the match (Matched), and the ring can be read."""
    DISCONNECT = "disconnect"
    """The broker is gone, or the connection to it."""
    FINISH = "finish"
    """The publisher has gone, or gave no sign of life."""
    LEAVE = "leave"
    """The ring was read to its end, can't be read, or must not be read any more."""


GATES: Mapping[GateState, Mapping[GateEvent, GateState]] = {
    GateState.NEW: {GateEvent.MATCH: GateState.EXPECTED},
    GateState.EXPECTED: {
        GateEvent.ATTACH: GateState.ATTACHED,
        GateEvent.DISCONNECT: GateState.UNSURE,
        GateEvent.UNMATCH: GateState.ENDED,
        GateEvent.LOSE: GateState.ENDED,
    },
    GateState.ATTACHED: {
        GateEvent.ATTACH: GateState.ATTACHED,  # it was reading on until the broker made the match
        GateEvent.DISCONNECT: GateState.READING_ON,
        GateEvent.UNMATCH: GateState.LEFT,
        GateEvent.LOSE: GateState.LOST,
    },
    GateState.UNSURE: {
        GateEvent.MATCH: GateState.EXPECTED,
        GateEvent.DISCONNECT: GateState.UNSURE,
        GateEvent.LOSE: GateState.ENDED,
    },
    GateState.READING_ON: {
        GateEvent.MATCH: GateState.ATTACHED,
        GateEvent.DISCONNECT: GateState.READING_ON,
        GateEvent.UNMATCH: GateState.LEFT,
        GateEvent.LOSE: GateState.LOST,
    },
    GateState.LEFT: {GateEvent.FORGET: GateState.ENDED},
    GateState.LOST: {GateEvent.FORGET: GateState.ENDED},
    GateState.ENDED: {},
}
"""The next state at the publisher's end, by state and event. Any other event in a state is an error."""

FEEDS: Mapping[FeedState, Mapping[FeedEvent, FeedState]] = {
    FeedState.NEW: {FeedEvent.ATTACH: FeedState.ATTACHED},
    FeedState.ATTACHED: {
        FeedEvent.DISCONNECT: FeedState.READING_ON,
        FeedEvent.FINISH: FeedState.FINISHING,
        FeedEvent.LEAVE: FeedState.ENDED,
    },
    FeedState.READING_ON: {
        FeedEvent.ATTACH: FeedState.ATTACHED,
        FeedEvent.DISCONNECT: FeedState.READING_ON,
        FeedEvent.FINISH: FeedState.FINISHING,
        FeedEvent.LEAVE: FeedState.ENDED,
    },
    FeedState.FINISHING: {
        FeedEvent.DISCONNECT: FeedState.FINISHING,
        FeedEvent.FINISH: FeedState.FINISHING,
        FeedEvent.LEAVE: FeedState.ENDED,
    },
    FeedState.ENDED: {},
}
"""The same at the subscription's end."""

STALE = (GateState.UNSURE, GateState.READING_ON)
"""The states in which the present broker has not made the match."""


class MatchError(Exception):
    """An event of a match that is impossible in its state: a bug of this library."""


_S = TypeVar("_S", bound=Enum)
_E = TypeVar("_E", bound=Enum)


class LocalMatch(Generic[_S, _E]):
    """A match of `owner`, made by the message `matched`. Only `on` changes the state."""

    __slots__ = ("_owner", "matched", "state")

    transitions: ClassVar[Mapping[Any, Mapping[Any, Any]]]
    kinds: ClassVar[tuple[str, str]]
    """Roles of this endpoint and its peer."""

    def __init__(self, owner: Owner, matched: m.Matched, state: _S) -> None:
        self._owner = owner
        self.matched = matched
        self.state = state

    def on(self, event: _E) -> None:
        """Change the state by `event`. Raises MatchError if the state does not allow it."""
        state = self.transitions[self.state].get(event)
        if state is None:
            raise MatchError(f"{self.describe()} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def describe(self) -> str:
        owner, other = self._owner, self.matched
        mine, others = self.kinds
        return (
            f"the match on '{owner.topic_name}' of {mine} {owner.id} (here) "
            f"and {others} {other.other} ({other.node})"
        )


class Gate(LocalMatch[GateState, GateEvent]):
    """A match of a publisher, and the records that its reader holds.

    Until the state is ATTACHED, the publisher only knows that a reader will come, and its first number.
    """

    __slots__ = ("hold", "is_lossless", "key", "place")

    transitions = GATES
    kinds = "publisher", "subscription"

    def __init__(self, owner: Owner, matched: m.Matched, hold: int) -> None:
        super().__init__(owner, matched, GateState.NEW)
        self.key = next(_keys)
        self.hold = hold
        """Until the gate is attached, the ring must keep all records from this number on."""
        self.is_lossless = matched.qos.is_lossless
        """Whether the publisher waits for the reader.

        It does not while the reader's process is silent, and not after memory ran out.
        """
        self.place: tuple[ReaderProcess, int] | None = None
        """The process and the slot in which the reader shows its position. None until ATTACHED."""

    @property
    def depth(self) -> int:
        """Records that must stay for the match."""
        qos = self.matched.qos
        return qos.depth if qos.history is History.KEEP_LAST else 1


class Feed(LocalMatch[FeedState, FeedEvent]):
    """A match of a subscription, and its reading of the publisher's ring."""

    __slots__ = ("doorbell", "final_seq", "identity", "proxy", "slot")

    transitions = FEEDS
    kinds = "subscription", "publisher"

    def __init__(self, owner: Owner, matched: m.Matched, proxy: "PublisherProxy", slot: int) -> None:
        super().__init__(owner, matched, FeedState.NEW)
        self.proxy = proxy
        self.slot = slot
        self.identity = 0, 0  # of the newest segment, to recognize the same segment
        self.doorbell: Descriptor | None = (
            None  # the publisher's: kept open, because the native reader only has its number
        )
        self.final_seq = 0  # the last number of a publisher that went while the broker was lost
