"""What the broker knows of: peers, nodes, publishers, subscriptions, topics. Plain state, no rules."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakSet

import msgspec

from bus.base.ids import EndpointId, NodeId, PeerId
from bus.qos import Durability, Liveliness, QoSProfile
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import EndpointRecord, EndpointStatistics, NodeRecord, Report
from bus.wire.runs import Account, RunQueue
from busd.core.access import Subject
from busd.core.effects import Flush
from busd.core.rate_limit import TokenBucket

MessageType = tuple[str, str]
"""A type's name and hash."""

_MOST_GONE = 128
"""Publishers that have gone, of which a subscription's numbers are kept; more may come in `last_seqs`, until
all its matches are made."""

GRAPH = -1
"""Stands where an endpoint's number may, for the graph."""

SOCKET, SHM = "socket", "shm"
"""The routes of a match."""


@dataclass(slots=True, eq=False, kw_only=True)
class Holder:
    """What one process, or all processes of one user, make the broker hold."""

    uid: int
    queued: Account
    """Bytes of samples that wait for it."""
    history: Account
    """Bytes kept for its publishers."""
    control: Account
    """Bytes of control frames that wait for it; the shell charges them."""
    declarations: TokenBucket
    signals: TokenBucket
    """Control frames of all other kinds: acknowledgements, reports, attachments."""
    topics: Counter[str] = field(default_factory=Counter)
    """Endpoints by topic."""
    matches: int = 0
    schema_bytes: int = 0
    descriptors: "WeakSet[Any]" = field(default_factory=WeakSet)
    """Those that it sent and that are held still, by whatever; opaque here."""
    refused: int = 0
    """How often a limit stood in its way."""
    told_ns: dict[str, int] = field(default_factory=dict)
    """When one last did, by resource."""


@dataclass(slots=True, eq=False, kw_only=True)
class User(Holder):
    """What all processes of one user make the broker hold."""

    peers: "dict[PeerId, Peer]" = field(default_factory=dict)
    nodes: int = 0
    endpoints: int = 0
    unfinished: Account
    """Bytes of messages that have not come whole; the shell charges them."""
    arrivals: TokenBucket
    """Processes that may come now, before they have to wait to be let in."""
    mishaps: TokenBucket
    """Connections that came to nothing of which the log may still tell now."""
    untold: int = 0
    """And those of which it did not."""
    absent: int = 0
    """Subscriptions whose process was lost, and that may be back (busd.core.absent)."""


@dataclass(slots=True, eq=False, kw_only=True)
class Peer(Holder):
    """One connected process and all that it makes the broker hold."""

    id: PeerId
    pid: int
    user: User
    program: str
    last_heard_ns: int
    lease_ns: int = 0
    """Of silence after which it counts as hung: what it was told when it came."""
    version: str = ""
    """The release of busd that the process has."""
    questions: TokenBucket
    """Those for the graph that are answered now, before it has to wait."""
    paused_ns: int = 0
    """Until when it is not listened to."""
    gids: frozenset[int] | None = frozenset()
    """All groups of the process; None where they can't be told."""
    is_guest: bool = False
    """Of another user than the daemon's own and root."""
    hears_of_namesakes: bool = False
    """It understands the message Namesake."""
    nodes: dict[NodeId, "Node"] = field(default_factory=dict)
    endpoints: "dict[EndpointId, Publisher | Subscription]" = field(default_factory=dict)
    types: dict[MessageType, int] = field(default_factory=dict)
    """Declared types with the size of their schemas."""
    lapsed: "set[Publisher]" = field(default_factory=set)
    """Publishers with automatic liveliness whose lease ended."""
    is_silent: bool = False
    """It was not heard for its lease: nobody waits for it (busd.core.silence)."""
    hears_of_silence: bool = False
    """It understands Silence."""
    perishable: "set[Subscription]" = field(default_factory=set)
    """Subscriptions that samples with a lifespan may wait for."""
    doorbell: object | None = None
    readers: object | None = None
    """What the process shares, for the route shm: descriptors, opaque here. Both, or none."""
    has_shared: bool = False
    withheld: int = 0
    """The endpoint that is being made for it, or GRAPH: news of it wait until that is done. 0: nothing."""

    @property
    def subject(self) -> Subject:
        """The process, as rules of access look at it."""
        return Subject(self.uid, self.gids)

    def subscriptions(self) -> "list[Subscription]":
        return [one for one in self.endpoints.values() if isinstance(one, Subscription)]

    def publishers(self) -> "list[Publisher]":
        return [one for one in self.endpoints.values() if isinstance(one, Publisher)]

    def describe(self) -> str:
        return f"{self.program or 'process'} (pid {self.pid})"


@dataclass(slots=True, eq=False)
class Node:
    id: NodeId
    peer: Peer
    name: str
    namespace: str
    endpoints: "dict[EndpointId, Publisher | Subscription]" = field(default_factory=dict)
    full_name: str = field(init=False)
    knows_namesake: bool = False
    """Its process was told that another node has the same name."""

    def __post_init__(self) -> None:
        self.full_name = f"{self.namespace.rstrip('/')}/{self.name}"

    def record(self) -> NodeRecord:
        return NodeRecord(id=self.id, name=self.name, namespace=self.namespace, pid=self.peer.pid)


@dataclass(slots=True, eq=False)
class Topic:
    """Exists as long as it has an endpoint."""

    name: str
    publishers: "dict[EndpointId, Publisher]" = field(default_factory=dict)
    subscriptions: "dict[EndpointId, Subscription]" = field(default_factory=dict)


@dataclass(slots=True)
class Sharing:
    """What is to be remembered of a match on the route shm."""

    at_ns: int
    """Since when it is."""
    is_attached: bool = False
    """The subscription reads the ring."""


@dataclass(slots=True, eq=False)
class Endpoint:
    """What publishers and subscriptions have in common. `report` is the process's own last word."""

    id: EndpointId
    node: Node
    topic: Topic
    type: MessageType
    gid: bytes
    qos: QoSProfile
    max_message_bytes: int
    report: Report | None = field(default=None, init=False)
    is_lossless: bool = field(init=False)

    kind = ""

    def __post_init__(self) -> None:
        self.is_lossless = self.qos.is_lossless

    def statistics(self) -> EndpointStatistics:
        raise NotImplementedError

    def record(self, *, statistics: bool = False) -> EndpointRecord:
        return EndpointRecord(
            id=self.id,
            kind=self.kind,
            node=self.node.id,
            topic=self.topic.name,
            type_name=self.type[0],
            type_hash=self.type[1],
            gid=self.gid,
            qos=self.qos,
            statistics=self.statistics() if statistics else None,
        )


@dataclass(slots=True, eq=False)
class Publisher(Endpoint):
    """`matches` are all; of these `routed` are on the route socket, `shared` on the route shm.

    Of those in neither, some were rerouted: first they have yet to leave the ring (`leaving`), and then the
    publisher has yet to send them what they have missed. Others have had all up to a number (`behind`), alone
    or from the publisher as it was before, which is yet to come a second time: they get nothing before that.

    `acked` holds, for each routed lossless subscription, the last number that it has taken.
    """

    next_seq: int
    lifespan_ns: int
    lease_ns: int
    is_manual: bool
    last_sign_ns: int
    history: RunQueue | None
    samples: int = 0
    bytes: int = 0
    is_alive: bool = True
    has_left: bool = False
    """It took its leave, and will not come back."""
    matches: "dict[EndpointId, Subscription]" = field(default_factory=dict)
    routed: "dict[EndpointId, Subscription]" = field(default_factory=dict)
    shared: dict[EndpointId, Sharing] = field(default_factory=dict)
    leaving: dict[EndpointId, Sharing] = field(default_factory=dict)
    behind: dict[EndpointId, int] = field(default_factory=dict)
    ring: object | None = None
    """A descriptor, opaque here; None where all goes by socket."""
    has_shared: bool = False
    """A match is, or was, on the route shm: subscriptions may have taken what did not come through here."""
    acked: dict[EndpointId, int] = field(default_factory=dict)
    credited: int = 0
    is_credit_ahead: bool = False
    """All have taken more than came through here: credit for it is given when it comes."""
    uncredited_bytes: int = 0

    kind = "publisher"

    @property
    def does_more(self) -> bool:
        """With a run there is more to do than to queue it for those that it is `routed` to."""
        return bool(
            self.history is not None
            or self.lease_ns
            or self.behind
            or self.is_credit_ahead
            or (self.is_lossless and not self.acked)
        )

    def is_catching_up(self, subscription: EndpointId) -> bool:
        """It was rerouted and has left the ring; it gets what was sent to it alone, and nothing else yet."""
        return not any(subscription in some for some in (self.shared, self.leaving, self.routed, self.behind))

    def conclude(self) -> int:
        """It takes its leave: how many went to others by its ring since its last run, as it has said."""
        gap = self.report.samples + 1 - self.next_seq if self.ring is not None and self.report else 0
        self.next_seq += max(0, gap)
        return max(0, gap)

    def route(self, subscription: EndpointId) -> str:
        """The route of the match with `subscription`."""
        return SHM if subscription in self.shared else SOCKET

    def statistics(self) -> EndpointStatistics:
        mine = self.report
        reported = mine.samples if mine else 0
        at_ns = mine.at_ns if mine else 0
        if self.samples > reported:  # more has come since: that was counted here
            at_ns = self.node.peer.last_heard_ns
        return EndpointStatistics(
            samples=max(self.samples, reported),
            bytes=max(self.bytes, mine.bytes if mine else 0),
            dropped=mine.dropped if mine else {},
            at_ns=at_ns,
        )


class Owed(msgspec.Struct, gc=False):  # there is one for each match: the collector need not look at them
    """What is for a subscription, of one publisher: all from a number on.

    0: it reads the publisher's ring, and knows from where on.
    """

    first_seq: int
    is_kept: bool
    """What it does not get may come once more, out of the history that the publisher keeps."""
    has_left: bool = False
    """The publisher took its leave."""


@dataclass(slots=True, eq=False)
class Subscription(Endpoint):
    """`queue` holds what waits for the process; `dropped` counts what the broker dropped, by reason.

    `began` holds, for each match on the route socket, the number of the first sample that was routed for it;
    `returned` those of them that were there before: what was published meanwhile, it has lost. `owed` is, by
    gid, for publishers that have gone, and for those of which something was for it before `began`.
    """

    queue: RunQueue
    last_seqs: dict[bytes, int]
    matches: dict[EndpointId, Publisher] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    began: dict[EndpointId, int] = field(default_factory=dict)
    returned: set[EndpointId] = field(default_factory=set)
    owed: dict[bytes, Owed] = field(default_factory=dict)
    dropped_before: dict[str, int] = field(default_factory=dict)
    """The same as `dropped`, before its process was lost and came back."""
    expected_besides: int = 0
    """Samples of matches that have ended, and those that were sent to this subscription alone."""
    is_drop_report_due: bool = False
    flush: Flush = field(init=False)
    """The effect that says that the queue is no longer empty; made once, because each run needs it."""

    kind = "subscription"

    def __post_init__(self) -> None:
        Endpoint.__post_init__(self)
        self.flush = Flush(self.node.peer.id, self.queue)

    def begin(self, publisher: Publisher) -> None:
        """From now on what `publisher` sends to all is for this subscription, too."""
        self.began.setdefault(publisher.id, publisher.next_seq)

    def owe(self, publisher: Publisher, first_seq: int) -> None:
        """All from `first_seq` on is for it."""
        owed = self.owed.get(publisher.gid)
        if owed is None:
            is_wanted = keeps_history(self.qos) or (self.is_lossless and publisher.is_lossless)
            is_kept = publisher.history is not None and is_wanted
            self.owed[publisher.gid] = Owed(first_seq, is_kept)
        else:
            owed.first_seq = min(owed.first_seq or first_seq, first_seq)

    def owed_by(self, publisher: Publisher) -> Owed | None:
        """What of a publisher that is matched is for it, if anything."""
        if self.id in publisher.shared:
            return Owed(0, is_kept=False)
        known_seq = publisher.behind.get(self.id)
        first_seq = self.began.get(publisher.id) if known_seq is None else known_seq + 1
        if first_seq is None:
            return None
        self.owe(publisher, first_seq)
        return self.owed[publisher.gid]

    def end(self, publisher: Publisher) -> int:
        """The match has ended; returns up to which number it has had all, or that was routed for it."""
        self.returned.discard(publisher.id)
        began = self.began.pop(publisher.id, None)
        if began is not None:
            self.expected_besides += publisher.next_seq - began
            self.remember(publisher, publisher.next_seq - 1)
            self.owe(publisher, began)
            self.owed[publisher.gid].has_left = publisher.has_left
        return self.last_seqs.get(publisher.gid, 0)

    def end_sharing(self, publisher: Publisher) -> None:
        """The publisher has left, with what it has said is in its ring."""
        self.remember(publisher, publisher.next_seq - 1)
        self.owed[publisher.gid] = Owed(0, is_kept=False, has_left=True)

    def remember(self, publisher: Publisher, last_seq: int) -> None:
        """It has had all up to `last_seq`, or that was routed for it; the publisher may send it once more."""
        self.last_seqs[publisher.gid] = max(last_seq, self.last_seqs.pop(publisher.gid, 0))
        self.forget_oldest()

    def forget_oldest(self) -> None:
        """Of publishers that may come back, so many are remembered."""
        while len(self.last_seqs) > _MOST_GONE:
            oldest = next(iter(self.last_seqs))
            del self.last_seqs[oldest]
            self.owed.pop(oldest, None)

    def dropped_in_all(self) -> dict[str, int]:
        """What the broker dropped for it, also before it came back."""
        both = self.dropped_before, self.dropped
        total = {reason: sum(one.get(reason, 0) for one in both) for reason in both[0] | both[1]}
        return {reason: min(count, MAX_COUNT) for reason, count in total.items()}  # a publisher may lie

    @property
    def expected(self) -> int:
        """Samples that were to be routed to it, by the publishers' numbers; whatever became of them."""
        routed = sum(self.matches[publisher].next_seq - began for publisher, began in self.began.items())
        return min(self.expected_besides + routed, MAX_COUNT)

    def statistics(self) -> EndpointStatistics:
        mine = self.report
        dropped = dict(self.dropped)
        for reason, count in (mine.dropped if mine else {}).items():
            dropped[reason] = dropped.get(reason, 0) + count
        return EndpointStatistics(
            samples=mine.samples if mine else 0,
            bytes=mine.bytes if mine else 0,
            queued=self.queue.count + (mine.queued if mine else 0),
            dropped=dropped,
            expected=min(max(self.expected + (mine.expected - mine.repeated if mine else 0), 0), MAX_COUNT),
            at_ns=mine.at_ns if mine else 0,
        )


def keeps_history(qos: QoSProfile) -> bool:
    return qos.durability is Durability.TRANSIENT_LOCAL


def is_manual(qos: QoSProfile) -> bool:
    return qos.liveliness is Liveliness.MANUAL_BY_TOPIC
