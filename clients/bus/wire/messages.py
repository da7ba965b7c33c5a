"""The control messages: msgspec Structs with a tag for each kind, as MessagePack maps.

Later versions may add fields with a default; a receiver ignores unknown fields. The client chooses the number
`request`, which is returned in the one answer. The broker assigns the ids. `descriptors` is the number of
file descriptors that come with the frame. `bus.wire.routes` has the messages about routes.
"""

from typing import Literal

from msgspec import field

from bus.qos import QoSProfile
from bus.vocabulary import Route
from bus.wire.bounds import (
    AgeParts,
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

    The broker sets:

    - `lease_s`: a client that is silent for longer counts as hung
    - `background`: a client has started this broker, which ends when it is idle; a client may start the next
      one
    - `began_ns`: its start, which distinguishes it from an earlier broker with the same process id

    `clock_ns`, from a client: nanoseconds by which its monotonic clock is ahead of the machine's first time
    namespace.
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
    """Sign of life. A Ping with a number gets an answer, after the answers to all earlier requests."""

    number: int = 0


class Pong(Message, frozen=True, tag="pong"):
    number: int = 0


# --- from a client


class DeclareType(Message, frozen=True, tag="type"):
    """Declares a message type on this connection, before the first endpoint that uses it."""

    type_name: str
    type_hash: str
    schema: bytes = b"\xc0"


class CreateNode(Message, frozen=True, tag="node+"):
    """Creates a node. `origin`: the node mirrors a node of another bus."""

    request: int
    name: str
    namespace: str = "/"
    origin: Origin | None = None


class DestroyNode(Message, frozen=True, tag="node-"):
    node: int


class CreatePublisher(Message, frozen=True, tag="pub+"):
    """Creates a publisher.

    `next_seq`: the number of its first sample; `gid` identifies the endpoint for life. `stands_for`: the gid
    of a publisher of another bus, which the graph shows instead of `gid`. The frame carries the publisher's
    ring, if there is one. `places`: the gids of lost subscriptions with a place at the publisher; each of
    them used the socket route.
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
    """Creates a subscription. `last_seqs`: by publisher gid, the last number received (after a reconnection).

    `takes_history`: it gets the history of each publisher that keeps one, for any durability in `qos`.
    `local_only`: it only matches publishers of nodes without an origin. `role` `mirror`: it stands for a
    subscription of another bus, and gets no samples. `role` `tap`: it takes samples for mirrors, and counts
    nowhere.
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
    """Acknowledges that a keep-all subscription has taken all samples of `source` up to `seq`."""

    subscription: int
    source: int
    seq: int


class Report(Message, frozen=True, tag="report"):
    """Totals that only the endpoint's process knows; sent when they change, at most twice a second.

    `at_ns`: the time of counting, on the monotonic clock. The ages are no totals: they are the number of
    messages that a subscription has taken since its last report, the sum of their ages and the highest age.
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
    most_missed: Count = 0
    age_parts: AgeParts = ()


class GetGraph(Message, frozen=True, tag="graph?"):
    request: int
    statistics: bool = False


class GetType(Message, frozen=True, tag="type?"):
    request: int
    type_name: str
    type_hash: str


class Observe(Message, frozen=True, tag="observe"):
    """Requests a snapshot now. `on`: also a GraphChanged at every later change; off: no more of them."""

    request: int
    on: bool = True


class GetPeers(Message, frozen=True, tag="peers?"):
    request: int


class StopBroker(Message, frozen=True, tag="stop"):
    """Stops the broker. `restart`: the installed version then starts at the same socket."""

    request: int
    restart: bool = False


class Reload(Message, frozen=True, tag="reload"):
    """Makes the broker read its configuration again."""

    request: int


# --- from the broker


class Created(Message, frozen=True, tag="created"):
    """Answer to a Create...: the id, and the QoS and limits by the broker's rules."""

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
    """Refuses a request. `resource` is set if a quota is the reason, `denied` if access was denied.

    `again`: the reason is temporary, so try again.
    """

    request: int
    text: str
    resource: str = ""
    used: int = 0
    limit: int = 0
    denied: bool = False
    again: bool = False


class Fault(Message, frozen=True, tag="fault"):
    """The last message before the broker closes the connection. `again`: temporary reason, so try again."""

    text: str
    again: bool = False


class Leaving(Message, frozen=True, tag="leaving"):
    """The broker ends in order. Send nothing after this frame, and read to the end. Only with LEAVING."""

    text: str


class Matched(Message, frozen=True, tag="matched"):
    """`endpoint` (yours) and `other` now form a match, since `at_ns` of the monotonic clock.

    On the route shm, the frame carries the publisher's ring and its process's doorbell to a subscription.
    `stands_for`: the gid to show for `other`. `is_tap`: `other` is a tap. `last_seq`, to a publisher with the
    capability PLACES: the subscription was lost and is back, and has received all samples up to this number.
    Send the missed samples only to it, and then CaughtUp. `at_ns` is a time of your clock. `clock_ns`, to a
    subscription: nanoseconds by which the clock of the publisher's process, which stamps samples, is ahead of
    yours. `awaits_sign`, to a subscription: do not count the publisher as alive or not alive until
    LivelinessChanged with `alive`.
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
    awaits_sign: bool = False


class Unmatched(Message, frozen=True, tag="unmatched"):
    """A match has ended.

    `lost`: the process of `other` ended its connection without a goodbye, and may still run. (Busd 0.1.0 set
    `lost` only for subscriptions.) `last_seq`, to a subscription: the last number that it has received or
    that was routed to it. `keep_s`, to a lossless publisher: keep the place of the lossless subscription for
    this time, because it may come back. A second Unmatched, with 0, means that it will not.
    """

    endpoint: int
    other: int
    lost: bool = False
    last_seq: Count = 0
    keep_s: Lease = 0.0


class Incompatible(Message, frozen=True, tag="incompatible"):
    """`endpoint` (yours) matches none of `node`'s, by `policy`: TYPE, ACCESS, or the last of its QoS.

    `type_hash`: the other's hash, if both types have the same name; GetType returns the type's description.
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
    """To a subscription: a matched publisher's lease ended or was renewed."""

    subscription: int
    publisher: int
    alive: bool


class LivelinessLost(Message, frozen=True, tag="lost"):
    """To a publisher: it did not assert its liveliness in time."""

    publisher: int


class Silence(Message, frozen=True, tag="silence"):
    """To a lossless publisher: the process of a lossless subscription has sent nothing for `silent_s`.

    So don't wait for it until another Silence with `is_over`. Only to peers with the capability SILENCE.
    """

    publisher: int
    subscription: int
    silent_s: Lease
    is_over: bool = False


class Dropped(Message, frozen=True, tag="dropped"):
    """Total drops of the broker for a subscription, by reason.

    After a process had lost its connection and is back: `missed` has, by publisher, the first number for the
    subscription (0: the subscription knows it from a ring), and the last one (0: the publisher exists, and
    Matched has it). A repeated message has the same values. `before`: drops for the subscription over its
    earlier connections.
    """

    subscription: int
    dropped: dict[str, int]
    missed: Missed = field(default_factory=dict)
    before: Drops = field(default_factory=dict)


class Credit(Message, frozen=True, tag="credit"):
    """To a keep-all publisher: all subscriptions that must acknowledge have taken the samples up to `seq`."""

    publisher: int
    seq: Count


class GraphSnapshot(Message, frozen=True, tag="graph"):
    """Snapshot of the broker's whole graph, at `revision`."""

    request: int
    revision: int
    nodes: tuple[NodeRecord, ...]
    endpoints: tuple[EndpointRecord, ...]
    matches: tuple[MatchRecord, ...]
    pid: int = 0


class GraphChanged(Message, frozen=True, tag="graph*"):
    """The changes from `revision` - 1 to `revision`."""

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
    """The resources of busd that each process uses, and `[limits]`.

    Root and busd's own user see all processes, other users only their own.
    """

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
