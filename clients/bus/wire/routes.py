"""The control messages about routes: shared memory of a process, rings and their readers, changes to the
socket.

Part of `bus.wire.messages`, whose rules apply here, too.
"""

from bus.wire.bounds import Count, Descriptors, Id, Pid, Slot, Text
from bus.wire.codec import Message

# --- from a client


class Share(Message, frozen=True, tag="share"):
    """Carries this process's doorbell and readers' segment, before the first endpoint that shares memory."""

    descriptors: Descriptors = 2


class Attach(Message, frozen=True, tag="attach"):
    """The subscription reads the ring of `source`, and reports its position in this slot of its segment."""

    subscription: int
    source: int
    slot: Slot


class RefuseRoute(Message, frozen=True, tag="noshm"):
    """This end can't share memory in the match of `endpoint` (its own) with `other`; `text` is the reason."""

    endpoint: int
    other: int
    text: Text


class LeaveRing(Message, frozen=True, tag="left"):
    """After Rerouted: the subscription has left the ring of `source`, and has received all samples up to
    `seq`."""

    subscription: int
    source: int
    seq: Count = 0


class CaughtUp(Message, frozen=True, tag="caught"):
    """After Rerouted: the publisher has sent the subscription its missed samples.

    Now it gets the samples for all.
    """

    publisher: int
    subscription: int


class ReplaceRing(Message, frozen=True, tag="ring"):
    """The publisher continues in another ring, which comes with this message."""

    publisher: int
    descriptors: Descriptors = 1


# --- from the broker


class Attached(Message, frozen=True, tag="attached"):
    """To a publisher: the subscription reads its ring, and reports its position in this slot.

    Carries the readers' segment and the doorbell of the subscription's process. `process` is the number of
    this process on the connection, `pid` its number on the machine.
    """

    publisher: int
    subscription: int
    slot: Slot
    process: int
    pid: Pid
    descriptors: Descriptors = 2


class RingReplaced(Message, frozen=True, tag="ring*"):
    """To a subscription: `source` continues in another ring, which comes with this message."""

    subscription: int
    source: int
    descriptors: Descriptors = 1


class Rerouted(Message, frozen=True, tag="rerouted"):
    """The match of `endpoint` (yours) with `other` now uses `route`. `at_ns`: as in its Matched.

    The broker sends it first to the subscription. It sends it to the publisher after the subscription has
    left the ring, at number `last_seq`.
    """

    endpoint: int
    other: Id
    route: str
    at_ns: Count = 0
    last_seq: Count = 0
