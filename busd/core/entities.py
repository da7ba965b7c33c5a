"""The entities of the broker: peers, nodes, publishers, subscriptions, topics, matches.

Plain state. The only rule: a match changes by its table (`busd.core.match`), and with it the tables of its
ends that follow from its state.
"""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakSet

import msgspec

from bus.base.ids import EndpointId, NodeId, PeerId
from bus.qos import Durability, Liveliness, QoSProfile
from bus.vocabulary import Route
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import EndpointRecord, EndpointStatistics, NodeRecord, Origin, Report
from bus.wire.runs import Account, RunQueue
from busd.core.access import Subject
from busd.core.crowd import Crowd
from busd.core.effects import Flush
from busd.core.history import PublisherHistory
from busd.core.match import SHARED, TRANSITIONS, MatchError, MatchEvent, MatchState
from busd.core.rate_limit import TokenBucket

MessageType = tuple[str, str]
"""A type's name and hash."""

_MOST_GONE = 128
"""Limit of departed publishers whose numbers a subscription keeps. `last_seqs` may bring more, until all its
matches are made.
"""

GRAPH = -1
"""In place of an endpoint's number: the graph."""

_Bytes = bytes


@dataclass(slots=True, eq=False, kw_only=True)
class Holder:
    """Resources that the broker holds for one process, or for all processes of one user."""

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
    topics: dict[str, int] = field(default_factory=dict)
    """Endpoints by topic."""
    matches: int = 0
    schema_bytes: int = 0
    descriptors: "WeakSet[Any]" = field(default_factory=WeakSet)
    """Descriptors that it sent and that anything still holds; opaque here."""
    refused: int = 0
    """How often a limit has refused it something."""
    hit_ns: dict[str, int] = field(default_factory=dict)
    """When a limit last refused it something, by resource."""


@dataclass(slots=True, eq=False, kw_only=True)
class User(Holder):
    """Resources that the broker holds for all processes of one user."""

    peers: "dict[PeerId, Peer]" = field(default_factory=dict)
    nodes: int = 0
    endpoints: int = 0
    unfinished: Account
    """Bytes of messages that have not come whole; the shell charges them."""
    arrivals: TokenBucket
    """Processes that may come in now; more must wait."""
    mishaps: TokenBucket
    """Connections that came to nothing and may be logged now; more are only counted."""
    commands: TokenBucket
    """Requests to reload, stop or restart that are carried out now; more are refused."""
    unlogged: int = 0
    """Connections that came to nothing and were not logged."""
    absent: int = 0
    """Subscriptions of lost processes that may come back (busd.core.absent)."""


@dataclass(slots=True, eq=False, kw_only=True)
class Peer(Holder):
    """One connected process and the resources that the broker holds for it."""

    id: PeerId
    pid: int
    """0 if the process is in a pid namespace that busd can't see."""
    process: Hashable
    """Equal for the connections of one process, and for no others."""
    user: User
    program: str
    last_heard_ns: int
    lease_ns: int = 0
    """After so long without a sign of life it counts as hung; Hello said so."""
    clock_ns: int = 0
    """Nanoseconds by which its monotonic clock is ahead of busd's."""
    version: str = ""
    """The release of busd that the process has."""
    questions: TokenBucket
    """Questions about the graph that are answered now; more must wait."""
    paused_ns: int = 0
    """Until when the shell does not read it."""
    gids: frozenset[int] | None = frozenset()
    """All groups of the process, or None if they are unknown."""
    is_guest: bool = False
    """Whether its user is another than the daemon's own and root."""
    hears_of_namesakes: bool = False
    """Whether it understands the message Namesake."""
    nodes: dict[NodeId, "Node"] = field(default_factory=dict)
    endpoints: "dict[EndpointId, Publisher | Subscription]" = field(default_factory=dict)
    types: dict[MessageType, int] = field(default_factory=dict)
    """Declared types with the size of their schemas."""
    refused_types: dict[MessageType, str] = field(default_factory=dict)
    """Declared types that busd has not accepted, with the text that refuses their endpoints."""
    lapsed: "set[Publisher]" = field(default_factory=set)
    """Publishers with automatic liveliness after the end of their lease."""
    is_silent: bool = False
    """Whether it was not heard for its lease: then nothing waits for it (busd.core.silence)."""
    hears_of_silence: bool = False
    """Whether it understands the message Silence."""
    keeps_places: bool = False
    """Whether its lossless publishers keep the places of subscriptions that were lost (busd.core.places)."""
    perishable: "set[Subscription]" = field(default_factory=set)
    """Its subscriptions with queues that may hold samples with a lifespan."""
    doorbell: object | None = None
    readers: object | None = None
    """Descriptors that the process shares for the route shm; opaque here. Both, or none."""
    has_sent_share: bool = False
    """Whether it has sent Share; a second one is a fault."""
    is_bridge: bool = False
    """Whether it has, or had, a node with an origin."""
    has_gone: bool = False
    """Whether its connection is gone; its entities go, too."""
    withheld: int = 0
    """The endpoint that busd is making for it, or GRAPH. News about that waits until it is made. 0: none."""
    subject: Subject = field(init=False)
    """The process as rules of access see it."""

    def __post_init__(self) -> None:
        self.subject = Subject(self.uid, self.gids)

    def by_its_clock(self, at_ns: int) -> int:
        """A time of busd's clock, by the clock of the process."""
        return min(max(at_ns + self.clock_ns, 0), MAX_COUNT)

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
    """Whether its process knows that another node has the same name."""
    origin: Origin | None = None
    """The place that a bridge has brought it from."""

    def __post_init__(self) -> None:
        self.full_name = f"{self.namespace.rstrip('/')}/{self.name}"

    def record(self) -> NodeRecord:
        return NodeRecord(
            id=self.id, name=self.name, namespace=self.namespace, pid=self.peer.pid, origin=self.origin
        )


@dataclass(slots=True, eq=False)
class Topic:
    """Exists as long as it has an endpoint."""

    name: str
    publishers: "dict[EndpointId, Publisher]" = field(default_factory=dict)
    subscriptions: "dict[EndpointId, Subscription]" = field(default_factory=dict)
    guest_publishers: int = 0
    guest_subscriptions: int = 0
    """Publishers and subscriptions of guests among them."""


@dataclass(slots=True, eq=False)
class Endpoint:
    """Common parts of publishers and subscriptions. `report` is the process's last Report."""

    id: EndpointId
    node: Node
    topic: Topic
    type: MessageType
    gid: bytes
    qos: QoSProfile
    max_message_bytes: int
    report: Report | None = field(default=None, init=False)
    is_lossless: bool = field(init=False)
    shown_gid: bytes = field(init=False)
    """The gid that users know."""

    kind = ""

    def __post_init__(self) -> None:
        self.is_lossless = self.qos.is_lossless
        self.shown_gid = self.gid

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
            gid=self.shown_gid,
            qos=self.qos,
            statistics=self.statistics() if statistics else None,
        )


@dataclass(slots=True, eq=False)
class Publisher(Endpoint):
    """`routed`, `crowds`, `ahead` and `awaited` follow from the states of `matches`; only Match changes them.

    `routed`: the subscriptions of matches that are ROUTED, as the hot path needs them. `ahead`: the matches
    that are AHEAD. `awaited`: the matches for whose acknowledgements a lossless publisher waits.
    """

    next_seq: int
    lifespan_ns: int
    lease_ns: int
    is_manual: bool
    last_sign_ns: int
    history: PublisherHistory | None
    samples: int = 0
    bytes: int = 0
    is_alive: bool = True
    unaware: "dict[EndpointId, Match]" = field(default_factory=dict)
    """Matches since its last sign of life, of subscriptions with a lease. Empty with automatic liveliness."""
    has_left: bool = False
    """Whether it was closed in order, and will not come back."""
    matches: "dict[EndpointId, Match]" = field(default_factory=dict)
    routed: "dict[EndpointId, Subscription]" = field(default_factory=dict)
    crowds: dict[PeerId, Crowd] = field(default_factory=dict)
    """The same by process, if they are or were many; otherwise empty."""
    ahead: "dict[EndpointId, Match]" = field(default_factory=dict)
    awaited: "dict[EndpointId, Match]" = field(default_factory=dict)
    ring: object | None = None
    """A descriptor, opaque here; None if all goes by socket."""
    places: set[_Bytes] = field(default_factory=set)
    """Places of lossless subscriptions that were lost before it was declared: it keeps the samples that they
    have missed by socket.
    """
    has_shared: bool = False
    """Whether a match is, or was, on the route shm: subscriptions may have samples that did not come through
    here."""
    credited: int = 0
    is_credit_ahead: bool = False
    """Whether all subscriptions have taken more than came through busd. Credit for that is given when it
    comes.
    """
    uncredited_bytes: int = 0
    stands_for: "_Bytes" = b""
    """The gid of a publisher on another bus; shown instead of this publisher's gid."""

    kind = "publisher"

    def __post_init__(self) -> None:
        Endpoint.__post_init__(self)
        self.shown_gid = self.stands_for or self.gid

    @property
    def does_more(self) -> bool:
        """Whether a run takes more than queueing it for `routed`."""
        return bool(
            self.history is not None
            or self.lease_ns
            or self.ahead
            or self.is_credit_ahead
            or self.crowds
            or (self.is_lossless and not self.awaited)
        )

    def join_crowd(self, subscription: "Subscription", next_seq: int) -> None:
        """A routed subscription gets the samples from `next_seq` on by the crowd of its process."""
        peer = subscription.node.peer
        crowd = self.crowds.get(peer.id)
        if crowd is None:
            crowd = self.crowds[peer.id] = Crowd(peer.queued)
        crowd.join(subscription.id, subscription.queue.depth, next_seq)

    def leave_crowd(self, subscription: "Subscription") -> None:
        """Route no more to the subscription. It gets none of the samples that wait in the crowd."""
        peer = subscription.node.peer.id
        self.crowds[peer].leave(subscription.id)
        if not self.crowds[peer].members:
            del self.crowds[peer]

    def conclude(self) -> int:
        """It is closed in order. Returns how many samples went only into its ring since its last run."""
        gap = self.report.samples + 1 - self.next_seq if self.ring is not None and self.report else 0
        self.next_seq += max(0, gap)
        return max(0, gap)

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


class Owed(msgspec.Struct, gc=False):  # one for each match: the garbage collector ignores them
    """The number from which a publisher's samples are for a subscription.

    0: it reads the publisher's ring, which has the number.
    """

    first_seq: int
    is_kept: bool
    """Whether the publisher may repeat samples that it misses: the publisher keeps them."""
    has_left: bool = False
    """Whether the publisher was closed in order."""


@dataclass(slots=True, eq=False)
class Subscription(Endpoint):
    """`queue`: samples that wait for the process. `dropped`: samples that the broker dropped, by reason.

    The key of two tables is the gid, because publishers may come back. `last_seqs`: it has had all samples up
    to this number. `owed`: publishers that have gone, and publishers with samples for it before its match
    began.
    """

    queue: RunQueue
    last_seqs: dict[bytes, int]
    matches: "dict[EndpointId, Match]" = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    owed: dict[bytes, Owed] = field(default_factory=dict)
    dropped_before: dict[str, int] = field(default_factory=dict)
    """As `dropped`, from before its process was lost and came back."""
    expected_besides: int = 0
    """Samples expected of matches that have ended, and samples sent to this subscription alone."""
    missed: int = 0
    """Samples replaced in `queue` in a row, without a sample sent in between."""
    most_missed: int = 0
    head_after: tuple[int, int] = (0, 0)
    """The oldest sample after the last replacement: its publisher and number."""
    is_drop_report_due: bool = False
    takes_history: bool = False
    """Late or not, it gets the history of publishers that keep one, and the new samples of others."""
    local_only: bool = False
    """It matches publishers of nodes without an origin."""
    is_mirror: bool = False
    """It stands for a subscription on a different bus."""
    is_tap: bool = False
    """It takes samples for mirrors."""
    flush: Flush = field(init=False)
    """The effect for a queue that is no longer empty; made once, because each run needs it."""

    kind: str = field(default="subscription", init=False)

    def __post_init__(self) -> None:
        Endpoint.__post_init__(self)
        if self.is_tap:
            self.kind = "tap"
        self.flush = Flush(self.node.peer.id, self.queue)

    def owe(self, publisher: Publisher, first_seq: int) -> None:
        """All samples from `first_seq` on are for it."""
        owed = self.owed.get(publisher.gid)
        if owed is None:
            are_lossless = self.is_lossless and publisher.is_lossless
            if publisher.history is not None:
                is_kept = self.takes_history or are_lossless
            else:
                is_kept = are_lossless and publisher.node.peer.keeps_places
            self.owed[publisher.gid] = Owed(first_seq, is_kept)
        else:
            owed.first_seq = min(owed.first_seq or first_seq, first_seq)

    def remember(self, publisher: Publisher, last_seq: int) -> None:
        """All samples up to `last_seq` were received or routed. If the publisher sends them again, busd does
        not route them.
        """
        self.last_seqs[publisher.gid] = max(last_seq, self.last_seqs.pop(publisher.gid, 0))
        self.forget_oldest()

    def forget_oldest(self) -> None:
        """Bound the number of remembered publishers that may come back."""
        while len(self.last_seqs) > _MOST_GONE:
            oldest = next(iter(self.last_seqs))
            del self.last_seqs[oldest]
            self.owed.pop(oldest, None)

    def dropped_in_all(self) -> dict[str, int]:
        """Samples that the broker dropped for it, also before it came back."""
        both = self.dropped_before, self.dropped
        total = {reason: sum(one.get(reason, 0) for one in both) for reason in both[0] | both[1]}
        return {reason: min(count, MAX_COUNT) for reason, count in total.items()}  # peers may lie

    @property
    def expected(self) -> int:
        """How many samples were for it, by the publishers' numbers, whatever became of them."""
        routed = sum(match.routed_count for match in self.matches.values())
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
            age_count=mine.age_count if mine else 0,
            age_sum_ns=mine.age_sum_ns if mine else 0,
            age_max_ns=mine.age_max_ns if mine else 0,
            most_missed=max(self.most_missed, mine.most_missed if mine else 0),
            age_parts=mine.age_parts if mine else (),
        )


@dataclass(slots=True, eq=False)
class Match:
    """A publisher and a subscription that match. Nothing but `on` changes the state."""

    publisher: Publisher
    subscription: Subscription
    at_ns: int
    """When it was made."""
    state: MatchState = MatchState.NEW
    began_seq: int = 0
    """ROUTED, AHEAD: the number of the first sample that counts as routed for it. While it `is_repeated`: the
    number of the next one."""
    is_return: bool = False
    """Whether the subscription was there before: samples that went to others meanwhile are lost for it."""
    acked_seq: int | None = None
    """In a lossless match, the last number taken; None if the publisher does not wait for it."""

    @property
    def is_shared(self) -> bool:
        return self.state in SHARED

    @property
    def has_ended(self) -> bool:
        return self.state is MatchState.ENDED

    @property
    def route(self) -> str:
        return ROUTE_OF[self.state]

    @property
    def is_lossless(self) -> bool:
        """Whether the publisher waits for the subscription."""
        are_both = self.publisher.is_lossless and self.subscription.is_lossless
        return are_both and not self.subscription.is_mirror

    def on(self, event: MatchEvent) -> None:
        """`event` happens. Raises MatchError if it can't."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            raise MatchError(f"{self.describe()} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state
        publisher, subscription = self.publisher, self.subscription
        number = subscription.id
        if publisher.routed.pop(number, None) is not None and publisher.crowds:
            publisher.leave_crowd(subscription)
        publisher.ahead.pop(number, None)
        if state is MatchState.ROUTED:
            publisher.routed[number] = subscription
            if publisher.crowds:
                publisher.join_crowd(subscription, publisher.next_seq)
        elif state is MatchState.AHEAD:
            publisher.ahead[number] = self
        elif state is MatchState.ENDED and self.acked_seq is not None:
            self.excuse()

    def share(self) -> None:
        """From now on the subscription gets its samples from the ring."""
        self.on(MatchEvent.SHARE)
        self.publisher.has_shared = True
        self.publisher.places.discard(self.subscription.gid)
        self.subscription.owed.pop(self.publisher.gid, None)

    def begin_routing(self) -> None:
        """From now on the subscription gets the samples for all, except samples that it has already had."""
        publisher = self.publisher
        received_seq = self.subscription.last_seqs.get(publisher.gid)
        is_ahead = received_seq is not None and received_seq >= publisher.next_seq
        self.began_seq = received_seq + 1 if received_seq is not None and is_ahead else publisher.next_seq
        was_there = received_seq is not None and (self.is_return or self.state is MatchState.NEW)
        self.is_return = was_there and not is_ahead
        self.on(MatchEvent.ROUTE_AHEAD if is_ahead else MatchEvent.ROUTE)

    @property
    def is_repeated(self) -> bool:
        """Whether the publisher sends the samples missed by the lost subscription to this one alone."""
        return self.is_return and self.state is MatchState.CATCHING_UP

    def repeat_from(self, last_seq: int) -> None:
        """The subscription is back, and has had all up to `last_seq`: the publisher repeats the others."""
        publisher = self.publisher
        self.began_seq, self.is_return = last_seq + 1, True
        self.on(MatchEvent.CATCH_UP)
        self.subscription.owe(publisher, self.began_seq)
        publisher.credited = min(publisher.credited, last_seq)

    def end(self) -> int:
        """End it. Returns the last number that the subscription has had or that was routed to it."""
        publisher, subscription = self.publisher, self.subscription
        before = self.state
        self.on(MatchEvent.END)
        if before is MatchState.ROUTED:
            subscription.expected_besides += publisher.next_seq - self.began_seq
            subscription.remember(publisher, publisher.next_seq - 1)
            subscription.owe(publisher, self.began_seq)
            subscription.owed[publisher.gid].has_left = publisher.has_left
        last_seq = subscription.last_seqs.get(publisher.gid, 0)
        if before in SHARED and publisher.has_left:  # its last report has counted its ring
            subscription.remember(publisher, publisher.next_seq - 1)
            subscription.owed[publisher.gid] = Owed(0, is_kept=False, has_left=True)
        return last_seq

    @property
    def routed_count(self) -> int:
        """How many samples were routed to it as to all."""
        return self.publisher.next_seq - self.began_seq if self.state is MatchState.ROUTED else 0

    @property
    def owed(self) -> Owed | None:
        """Which samples of the publisher are for the subscription, or None."""
        if self.is_shared:
            return Owed(0, is_kept=False)
        if self.state not in (MatchState.ROUTED, MatchState.AHEAD) and not self.is_repeated:
            return None
        self.subscription.owe(self.publisher, self.began_seq)
        return self.subscription.owed[self.publisher.gid]

    def await_acks(self) -> None:
        """From now on the publisher waits until the subscription has taken the samples from the socket."""
        publisher = self.publisher
        self.acked_seq = (self.began_seq if self.is_repeated else max(self.began_seq, publisher.next_seq)) - 1
        publisher.awaited[self.subscription.id] = self
        # It has taken samples that the publisher has yet to send here. No acknowledgement will come for them.
        publisher.is_credit_ahead |= self.began_seq > publisher.next_seq

    def excuse(self) -> bool:
        """Have the publisher wait for it no more; returns whether it did."""
        self.acked_seq = None
        return self.publisher.awaited.pop(self.subscription.id, None) is not None

    def describe(self) -> str:
        publisher, subscription = self.publisher, self.subscription
        return (
            f"the match on '{publisher.topic.name}' of publisher {publisher.id} ({publisher.node.full_name}) "
            f"and subscription {subscription.id} ({subscription.node.full_name})"
        )


ROUTE_OF = (
    dict.fromkeys(MatchState, Route.SOCKET)
    | dict.fromkeys(SHARED, Route.SHM)
    | {MatchState.BRIDGED: Route.BRIDGE}
)
"""The route of a match in that state."""


def keeps_history(qos: QoSProfile) -> bool:
    return qos.durability is Durability.TRANSIENT_LOCAL


def is_manual(qos: QoSProfile) -> bool:
    return qos.liveliness is Liveliness.MANUAL_BY_TOPIC
