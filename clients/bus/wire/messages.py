"""The control messages: msgspec Structs, told apart by a tag, as MessagePack maps.

Fields may be added with a default in a later version; a receiver ignores those it doesn't know. A `request`
number is chosen by the client and comes back in the one answer to it. Ids are given by the broker. Where
`descriptors` is not 0, that many file descriptors come with the frame.
"""

from typing import Annotated

import msgspec
from msgspec import Meta

from bus.qos import QoSProfile
from bus.wire.decoder import Decoder
from bus.wire.layout import CONTROL, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES, MAX_COUNT
from bus.wire.records import EndpointRecord as EndpointRecord
from bus.wire.records import EndpointStatistics as EndpointStatistics
from bus.wire.records import MatchRecord as MatchRecord
from bus.wire.records import NodeRecord as NodeRecord

Count = Annotated[int, Meta(ge=0, le=MAX_COUNT)]
Seq = Annotated[int, Meta(ge=1, le=MAX_COUNT)]
Drops = Annotated[dict[Annotated[str, Meta(max_length=32)], Count], Meta(max_length=16)]
"""Samples dropped, by reason."""
Descriptors = Annotated[int, Meta(ge=0, le=2)]
"""How many file descriptors come with the frame (docs/protocol.md)."""


class Message(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="m", tag=True):
    """Base of all control messages."""


# --- both ways


class Hello(Message, frozen=True, tag="hello"):
    """The first frame in either direction.

    `lease_s` is the broker's: a client that is silent for longer counts as hung. So is `background`: it was
    started by a client and leaves when it is idle, so that a client may start the next one.
    """

    version: int
    capabilities: tuple[str, ...] = ()
    pid: int = 0
    program: str = ""
    lease_s: float = 0.0
    background: bool = False


class Ping(Message, frozen=True, tag="ping"):
    """Sign of life. Where it has a number it is answered, after everything that was asked before."""

    number: int = 0


class Pong(Message, frozen=True, tag="pong"):
    number: int = 0


# --- from a client


class DeclareType(Message, frozen=True, tag="type"):
    """Makes a message type known on this connection, before the first endpoint that uses it."""

    type_name: str
    type_hash: str
    schema: bytes = b"\xc0"


class Share(Message, frozen=True, tag="share"):
    """Brings this process's doorbell and readers' segment, before the first endpoint that shares memory."""

    descriptors: Descriptors = 2


class CreateNode(Message, frozen=True, tag="node+"):
    request: int
    name: str
    namespace: str = "/"


class DestroyNode(Message, frozen=True, tag="node-"):
    node: int


class CreatePublisher(Message, frozen=True, tag="pub+"):
    """`next_seq` is the number of the first sample that will come; `gid` names the endpoint for life.

    Brings the publisher's ring where it has one.
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


class CreateSubscription(Message, frozen=True, tag="sub+"):
    """`last_seqs`: by publisher gid, what has been received already (after a reconnection)."""

    request: int
    node: int
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile
    gid: bytes
    last_seqs: dict[bytes, int] = {}


class DestroyEndpoint(Message, frozen=True, tag="end-"):
    endpoint: int


class AssertLiveliness(Message, frozen=True, tag="alive"):
    publisher: int


class Ack(Message, frozen=True, tag="ack"):
    """A keep-all subscription has taken everything of `source` up to `seq`."""

    subscription: int
    source: int
    seq: int


class Attach(Message, frozen=True, tag="attach"):
    """The subscription reads the ring of `source`, and tells of itself in this slot of its segment."""

    subscription: int
    source: int
    slot: Annotated[int, Meta(ge=0, le=65535)]


class RefuseRoute(Message, frozen=True, tag="noshm"):
    """This end can't share memory in the match of `endpoint` (its own) with `other`, and says why."""

    endpoint: int
    other: int
    text: Annotated[str, Meta(max_length=1000)]


class CaughtUp(Message, frozen=True, tag="caught"):
    """After Rerouted: what that subscription missed was sent, to it alone. Now it gets what all get."""

    publisher: int
    subscription: int


class ReplaceRing(Message, frozen=True, tag="ring"):
    """The publisher has gone on to another ring, which comes with this."""

    publisher: int
    descriptors: Descriptors = 1


class Report(Message, frozen=True, tag="report"):
    """Totals that only the endpoint's process knows; sent when they change, twice a second at most."""

    endpoint: int
    samples: Count
    bytes: Count
    queued: Count = 0
    dropped: Drops = {}


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


class StopBroker(Message, frozen=True, tag="stop"):
    request: int


# --- from the broker


class Created(Message, frozen=True, tag="created"):
    """Answer to a Create...: the id, and the QoS and limit that hold after the broker's rules."""

    request: int
    id: int
    depth: int = 0
    max_message_bytes: int = 0
    window_samples: int = 0
    window_bytes: int = 0
    ring_bytes: int = 0


class Done(Message, frozen=True, tag="done"):
    request: int


class Refused(Message, frozen=True, tag="refused"):
    """A request was not carried out. `resource` is set where a quota is the reason."""

    request: int
    text: str
    resource: str = ""
    used: int = 0
    limit: int = 0


class Fault(Message, frozen=True, tag="fault"):
    """Last word before the connection is cut."""

    text: str


class Matched(Message, frozen=True, tag="matched"):
    """`endpoint` (yours) and `other` now form a match, since `at_ns` of the monotonic clock.

    On the route shm it brings a subscription the publisher's ring and its process's doorbell.
    """

    endpoint: int
    other: int
    node: str
    gid: bytes
    qos: QoSProfile
    route: str = "socket"
    next_seq: int = 1
    at_ns: int = 0
    descriptors: Descriptors = 0


class Unmatched(Message, frozen=True, tag="unmatched"):
    """`lost`: the process of `other` did not take its leave, so that it may still run."""

    endpoint: int
    other: int
    lost: bool = False


class Incompatible(Message, frozen=True, tag="incompatible"):
    """`endpoint` (yours) matches none of `node`'s. `policy`: TYPE, or the last QoS policy that differs."""

    endpoint: int
    topic: str
    node: str
    policy: str
    text: str


class Attached(Message, frozen=True, tag="attached"):
    """To a publisher: the subscription reads its ring, and tells of itself in this slot.

    Brings the readers' segment and the doorbell of its process, which `process` names on this connection and
    `pid` on the machine.
    """

    publisher: int
    subscription: int
    slot: int
    process: int
    pid: int
    descriptors: Descriptors = 2


class RingReplaced(Message, frozen=True, tag="ring*"):
    """To a subscription: `source` goes on in another ring, which comes with this."""

    subscription: int
    source: int
    descriptors: Descriptors = 1


class Rerouted(Message, frozen=True, tag="rerouted"):
    """The match of `endpoint` (yours) with `other` now goes by `route`. `at_ns`: as in its Matched."""

    endpoint: int
    other: int
    route: str
    at_ns: int = 0


class LivelinessChanged(Message, frozen=True, tag="liveliness"):
    """To a subscription: a matched publisher's lease ended or was taken up again."""

    subscription: int
    publisher: int
    alive: bool


class LivelinessLost(Message, frozen=True, tag="lost"):
    """To a publisher: it did not assert its liveliness in time."""

    publisher: int


class Dropped(Message, frozen=True, tag="dropped"):
    """Totals of what the broker dropped for a subscription, by reason."""

    subscription: int
    dropped: dict[str, int]


class Credit(Message, frozen=True, tag="credit"):
    """To a keep-all publisher: all that must take has taken everything up to `seq`."""

    publisher: int
    seq: int


class Graph(Message, frozen=True, tag="graph"):
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


_Both = Hello | Ping | Pong
_Declaring = DeclareType | CreateNode | DestroyNode | CreatePublisher | CreateSubscription | DestroyEndpoint
_Sharing = Share | Attach | RefuseRoute | CaughtUp | ReplaceRing
_Asking = GetGraph | GetType | Observe | StopBroker
FromClient = _Both | _Declaring | _Sharing | AssertLiveliness | Ack | Report | _Asking

_Answers = Created | Done | Refused | Graph | TypeDescription
_Matching = Matched | Unmatched | Incompatible | Attached | RingReplaced | Rerouted
_News = LivelinessChanged | LivelinessLost | Dropped | Credit | GraphChanged | Fault
FromBroker = _Both | _Answers | _Matching | _News

_encode = msgspec.msgpack.Encoder().encode


def encode_frame(message: Message) -> bytes:
    """The whole control frame that carries `message`."""
    body = _encode(message)
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


from_client = Decoder(FromClient)
from_broker = Decoder(FromBroker)
