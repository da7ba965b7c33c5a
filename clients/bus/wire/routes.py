"""The control messages about routes: what a process shares, which ring is read where, and the way back.

Part of `bus.wire.messages`, which says what holds for all.
"""

from bus.wire.bounds import Count, Descriptors, Id, Pid, Slot, Text
from bus.wire.codec import Message

# --- from a client


class Share(Message, frozen=True, tag="share"):
    """Brings this process's doorbell and readers' segment, before the first endpoint that shares memory."""

    descriptors: Descriptors = 2


class Attach(Message, frozen=True, tag="attach"):
    """The subscription reads the ring of `source`, and tells of itself in this slot of its segment."""

    subscription: int
    source: int
    slot: Slot


class RefuseRoute(Message, frozen=True, tag="noshm"):
    """This end can't share memory in the match of `endpoint` (its own) with `other`, and says why."""

    endpoint: int
    other: int
    text: Text


class LeaveRing(Message, frozen=True, tag="left"):
    """After Rerouted: the subscription reads the ring of `source` no more, and has had all up to `seq`."""

    subscription: int
    source: int
    seq: Count = 0


class CaughtUp(Message, frozen=True, tag="caught"):
    """After Rerouted: what that subscription missed was sent, to it alone. Now it gets what all get."""

    publisher: int
    subscription: int


class ReplaceRing(Message, frozen=True, tag="ring"):
    """The publisher has gone on to another ring, which comes with this."""

    publisher: int
    descriptors: Descriptors = 1


# --- from the broker


class Attached(Message, frozen=True, tag="attached"):
    """To a publisher: the subscription reads its ring, and tells of itself in this slot.

    Brings the readers' segment and the doorbell of its process, which `process` names on this connection and
    `pid` on the machine.
    """

    publisher: int
    subscription: int
    slot: Slot
    process: int
    pid: Pid
    descriptors: Descriptors = 2


class RingReplaced(Message, frozen=True, tag="ring*"):
    """To a subscription: `source` goes on in another ring, which comes with this."""

    subscription: int
    source: int
    descriptors: Descriptors = 1


class Rerouted(Message, frozen=True, tag="rerouted"):
    """The match of `endpoint` (yours) with `other` now goes by `route`. `at_ns`: as in its Matched.

    A subscription hears it first, and a publisher when that has left its ring, after number `last_seq`.
    """

    endpoint: int
    other: Id
    route: str
    at_ns: Count = 0
    last_seq: Count = 0
