"""The control messages: msgspec Structs, told apart by a tag, as MessagePack maps.

Fields may be added with a default in a later version; a receiver ignores those it doesn't know. The client
chooses the number `request`, which comes back in the one answer. The broker gives the ids. Where
`descriptors` is not 0, that many file descriptors come with the frame. Those about routes stand in
`bus.wire.routes`.
"""

from typing import Literal

from msgspec import field

from bus.qos import QoSProfile
from bus.vocabulary import Route
from bus.wire.bounds import (
    Capabilities,
    ClockOffset,
    Count,
    Descriptors,
    Drops,
    Gid,
    Id,
    LastSeqs,
    Lease,
    Missed,
    NextSeq,
    Pid,
    Places,
    Seq,
    Text,
)
from bus.wire.codec import Decoder
from bus.wire.codec import Message as Message
from bus.wire.codec import encode_frame as encode_frame
from bus.wire.records import AbsentRecord as AbsentRecord
from bus.wire.records import EndpointRecord as EndpointRecord
from bus.wire.records import EndpointStatistics as EndpointStatistics
from bus.wire.records import MatchRecord as MatchRecord
from bus.wire.records import NodeRecord as NodeRecord
from bus.wire.records import Origin as Origin
from bus.wire.records import PeerRecord as PeerRecord
from bus.wire.records import RoutingRecord as RoutingRecord
from bus.wire.records import UserRecord as UserRecord
from bus.wire.routes import Attach as Attach
from bus.wire.routes import Attached as Attached
from bus.wire.routes import CaughtUp as CaughtUp
from bus.wire.routes import LeaveRing as LeaveRing
from bus.wire.routes import RefuseRoute as RefuseRoute
from bus.wire.routes import ReplaceRing as ReplaceRing
from bus.wire.routes import Rerouted as Rerouted
from bus.wire.routes import RingReplaced as RingReplaced
from bus.wire.routes import Share as Share

# --- both ways


class Hello(Message, frozen=True, tag="hello"):
    """The first frame in either direction.

    The broker sets `lease_s`: a client that is silent for longer counts as hung; `background`: a client has
    started this broker and it ends when it is idle, so that a client may start the next one; `began_ns`: when
    it began, which tells it from an earlier one with the same process id. `clock_ns`, from a client:
    nanoseconds by which its monotonic clock is ahead of the machine's first time namespace.
    """

    version: int
    capabilities: Capabilities = ()
    pid: int = 0
    program: Text = ""
    lease_s: Lease = 0.0
    background: bool = False
    release: Text = ""
    began_ns: Count = 0
    clock_ns: ClockOffset = 0


class Ping(Message, frozen=True, tag="ping"):
    """Sign of life. One with a number is answered, after everything that was asked before."""

    number: int = 0


class Pong(Message, frozen=True, tag="pong"):
    number: int = 0


# --- from a client


class DeclareType(Message, frozen=True, tag="type"):
    """Makes a message type known on this connection, before the first endpoint that uses it."""

    type_name: str
    type_hash: str
    schema: bytes = b"\xc0"


class CreateNode(Message, frozen=True, tag="node+"):
    """`origin`: it stands for a node of another bus."""

    request: int
    name: str
    namespace: str = "/"
    origin: Origin | None = None


class DestroyNode(Message, frozen=True, tag="node-"):
    node: int


class CreatePublisher(Message, frozen=True, tag="pub+"):
    """`next_seq` is the number of the first sample that will come; `gid` names the endpoint for life.

    `stands_for`: the gid of a publisher of another bus, which the graph shows in place of `gid`. Brings the
    publisher's ring where it has one. `places`: the gids of the subscriptions that were lost and have a place
    there; each of them had its samples by socket.
    """

    request: int
    node: int
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile
    gid: bytes
    next_seq: Seq = 1
    descriptors: Descriptors = 0
    stands_for: Gid = b""
    places: Places = ()


class CreateSubscription(Message, frozen=True, tag="sub+"):
    """`last_seqs`: by publisher gid, what has been received already (after a reconnection).

    `takes_history`: the history of each publisher that keeps one, whatever the durability of `qos`.
    `local_only`: it matches publishers of nodes without an origin. `role`: `mirror`, it stands for one of
    another bus, and gets no samples; `tap`, it takes samples for mirrors, and is in no count.
    """

    request: int
    node: int
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile
    gid: bytes
    last_seqs: LastSeqs = field(default_factory=dict)
    takes_history: bool = False
    local_only: bool = False
    role: Literal["", "mirror", "tap"] = ""


class DestroyEndpoint(Message, frozen=True, tag="end-"):
    endpoint: int


class AssertLiveliness(Message, frozen=True, tag="alive"):
    publisher: int


class Ack(Message, frozen=True, tag="ack"):
    """A keep-all subscription has taken everything of `source` up to `seq`."""

    subscription: int
    source: int
    seq: int


class Report(Message, frozen=True, tag="report"):
    """Totals that only the endpoint's process knows; sent when they change, twice a second at most.

    `at_ns`: when they were counted, on the monotonic clock. The ages are no totals: of messages that a
    subscription has taken since its last report, of so many the sum of their ages and the highest.
    """

    endpoint: int
    samples: Count
    bytes: Count
    queued: Count = 0
    dropped: Drops = field(default_factory=dict)
    expected: Count = 0
    repeated: Count = 0
    at_ns: Count = 0
    age_count: Count = 0
    age_sum_ns: Count = 0
    age_max_ns: Count = 0


class GetGraph(Message, frozen=True, tag="graph?"):
    request: int
    statistics: bool = False


class GetType(Message, frozen=True, tag="type?"):
    request: int
    type_name: str
    type_hash: str


class Observe(Message, frozen=True, tag="observe"):
    """Asks for a snapshot now and for a GraphChanged at every later change (on) or for no more (off)."""

    request: int
    on: bool = True


class GetPeers(Message, frozen=True, tag="peers?"):
    request: int


class StopBroker(Message, frozen=True, tag="stop"):
    """`restart`: and begin anew, with what is installed now, at the same socket."""

    request: int
    restart: bool = False


class Reload(Message, frozen=True, tag="reload"):
    """Asks the broker to read its configuration again."""

    request: int


# --- from the broker


class Created(Message, frozen=True, tag="created"):
    """Answer to a Create...: the id, and the QoS and limit that hold after the broker's rules."""

    request: int
    id: Id
    depth: Count = 0
    max_message_bytes: Count = 0
    window_samples: Count = 0
    window_bytes: Count = 0
    ring_bytes: Count = 0


class Done(Message, frozen=True, tag="done"):
    request: int
    text: str = ""


class Refused(Message, frozen=True, tag="refused"):
    """A request was not carried out. `resource` is set where a quota is the reason, `denied` for access.

    `again`: the reason passes, so try again.
    """

    request: int
    text: str
    resource: str = ""
    used: int = 0
    limit: int = 0
    denied: bool = False
    again: bool = False


class Fault(Message, frozen=True, tag="fault"):
    """Last word before the connection is cut. `again`: the reason passes, so try again."""

    text: str
    again: bool = False


class Leaving(Message, frozen=True, tag="leaving"):
    """The broker ends in order: send nothing after this frame, read to the end. Only with LEAVING."""

    text: str


class Matched(Message, frozen=True, tag="matched"):
    """`endpoint` (yours) and `other` now form a match, since `at_ns` of the monotonic clock.

    On the route shm it brings a subscription the publisher's ring and its process's doorbell. `stands_for`:
    the gid to be shown for `other`. `is_tap`: `other` is one. `last_seq`, to a publisher with the
    capability PLACES: the subscription was lost and is back, and has had all up to there. Send what it has
    missed, to it alone, and then CaughtUp. `at_ns` is of your clock; `clock_ns`, to a subscription: what the
    clock of the publisher's process, by which its samples are stamped, is ahead of yours.
    """

    endpoint: int
    other: Id
    node: str
    gid: bytes
    qos: QoSProfile
    route: str = Route.SOCKET
    next_seq: NextSeq = 1
    at_ns: Count = 0
    descriptors: Descriptors = 0
    stands_for: Gid = b""
    is_tap: bool = False
    last_seq: Count | None = None
    clock_ns: ClockOffset = 0


class Unmatched(Message, frozen=True, tag="unmatched"):
    """`lost`: the process of `other` did not take its leave, so that it may still run. (Busd 0.1.0 said so of
    subscriptions only.)

    `last_seq`, to a subscription: the last number that it has had or that was routed to it. `keep_s`, to a
    lossless publisher: keep the place of the lossless subscription for so long, because it may come back. A
    second Unmatched, with 0, says that it will not.
    """

    endpoint: int
    other: int
    lost: bool = False
    last_seq: Count = 0
    keep_s: Lease = 0.0


class Incompatible(Message, frozen=True, tag="incompatible"):
    """`endpoint` (yours) matches none of `node`'s, by `policy`: TYPE, ACCESS, or the last of its QoS.

    `type_hash`: the other's, where both call their type the same; GetType tells how it is described.
    """

    endpoint: int
    topic: str
    node: str
    policy: str
    text: str
    type_hash: str = ""


class Namesake(Message, frozen=True, tag="namesake"):
    """A node of that process has the name of your `node`. Only to peers with the capability NAMESAKES."""

    node: int
    pid: Pid
    program: Text = ""


class LivelinessChanged(Message, frozen=True, tag="liveliness"):
    """To a subscription: a matched publisher's lease ended or was taken up again."""

    subscription: int
    publisher: int
    alive: bool


class LivelinessLost(Message, frozen=True, tag="lost"):
    """To a publisher: it did not assert its liveliness in time."""

    publisher: int


class Silence(Message, frozen=True, tag="silence"):
    """To a lossless publisher: nothing has come from the process of a lossless subscription for `silent_s`.

    So don't wait for it, until another Silence says that it `is_over`. Only to peers with the capability
    SILENCE.
    """

    publisher: int
    subscription: int
    silent_s: Lease
    is_over: bool = False


class Dropped(Message, frozen=True, tag="dropped"):
    """Totals of what the broker dropped for a subscription, by reason.

    After a process had lost its connection and is back: `missed`, by publisher, from which number on its
    samples were for the subscription (0: the subscription knows from a ring), and the last one (0: the
    publisher is there, and Matched has it). Repeated, it says the same. `before`: what was dropped for the
    subscription over its earlier connections.
    """

    subscription: int
    dropped: dict[str, int]
    missed: Missed = field(default_factory=dict)
    before: Drops = field(default_factory=dict)


class Credit(Message, frozen=True, tag="credit"):
    """To a keep-all publisher: all that must acknowledge have taken everything up to `seq`."""

    publisher: int
    seq: Count


class GraphSnapshot(Message, frozen=True, tag="graph"):
    """Snapshot of all that the broker knows, at `revision`."""

    request: int
    revision: int
    nodes: tuple[NodeRecord, ...]
    endpoints: tuple[EndpointRecord, ...]
    matches: tuple[MatchRecord, ...]
    pid: int = 0


class GraphChanged(Message, frozen=True, tag="graph*"):
    """What changed from `revision` - 1 to `revision`."""

    revision: int
    nodes_added: tuple[NodeRecord, ...] = ()
    nodes_removed: tuple[int, ...] = ()
    endpoints_added: tuple[EndpointRecord, ...] = ()
    endpoints_removed: tuple[int, ...] = ()
    matches_added: tuple[MatchRecord, ...] = ()
    matches_removed: tuple[MatchRecord, ...] = ()


class TypeDescription(Message, frozen=True, tag="type="):
    request: int
    schema: bytes


class Peers(Message, frozen=True, tag="peers"):
    """What each process makes busd hold, and `[limits]`. Root and busd's own user see all, others their
    own."""

    request: int
    peers: tuple[PeerRecord, ...]
    users: tuple[UserRecord, ...]
    routing: RoutingRecord = RoutingRecord()
    limits: dict[str, int | float] = field(default_factory=dict)
    absent: AbsentRecord = AbsentRecord()


_Both = Hello | Ping | Pong
_Declaring = DeclareType | CreateNode | DestroyNode | CreatePublisher | CreateSubscription | DestroyEndpoint
_Sharing = Share | Attach | RefuseRoute | LeaveRing | CaughtUp | ReplaceRing
_Asking = GetGraph | GetType | Observe | GetPeers | StopBroker | Reload
FromClient = _Both | _Declaring | _Sharing | AssertLiveliness | Ack | Report | _Asking

_Answers = Created | Done | Refused | GraphSnapshot | TypeDescription | Peers
_Matching = Matched | Unmatched | Incompatible | Attached | RingReplaced | Rerouted
_News = (
    LivelinessChanged
    | LivelinessLost
    | Silence
    | Dropped
    | Credit
    | GraphChanged
    | Namesake
    | Fault
    | Leaving
)
FromBroker = _Both | _Answers | _Matching | _News

from_client = Decoder(FromClient)
from_broker = Decoder(FromBroker)
