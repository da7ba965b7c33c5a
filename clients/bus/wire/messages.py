"""The control messages: msgspec Structs, told apart by a tag, as MessagePack maps.

Fields may be added with a default in a later version; a receiver ignores those it doesn't know. A `request`
number is chosen by the client and comes back in the one answer to it. Ids are given by the broker.
"""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from bus.errors import RemoteProtocolError
from bus.qos import QoSProfile
from bus.wire.layout import CONTROL, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES, MAX_COUNT

Count = Annotated[int, Meta(ge=0, le=MAX_COUNT)]
Seq = Annotated[int, Meta(ge=1, le=MAX_COUNT)]
Drops = Annotated[dict[Annotated[str, Meta(max_length=32)], Count], Meta(max_length=16)]
"""Samples dropped, by reason."""


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


class CreateNode(Message, frozen=True, tag="node+"):
    request: int
    name: str
    namespace: str = "/"


class DestroyNode(Message, frozen=True, tag="node-"):
    node: int


class CreatePublisher(Message, frozen=True, tag="pub+"):
    """`next_seq` is the number of the first sample that will come; `gid` names the endpoint for life."""

    request: int
    node: int
    topic: str
    type_name: str
    type_hash: str
    qos: QoSProfile
    gid: bytes
    next_seq: Seq = 1


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
    """`endpoint` (yours) and `other` now form a match."""

    endpoint: int
    other: int
    node: str
    gid: bytes
    qos: QoSProfile
    route: str = "socket"
    next_seq: int = 1


class Unmatched(Message, frozen=True, tag="unmatched"):
    endpoint: int
    other: int


class Incompatible(Message, frozen=True, tag="incompatible"):
    """`endpoint` (yours) matches none of `node`'s. `policy`: TYPE, or the last QoS policy that differs."""

    endpoint: int
    topic: str
    node: str
    policy: str
    text: str


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


class NodeRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    id: int
    name: str
    namespace: str
    pid: int


class EndpointStatistics(msgspec.Struct, frozen=True, omit_defaults=True):
    """Live counters of an endpoint.

    Of a publisher: samples and bytes published. Of a subscription: samples and bytes delivered, samples
    waiting (in the broker and in the process), and samples dropped by reason.
    """

    samples: int = 0
    bytes: int = 0
    queued: int = 0
    dropped: dict[str, int] = {}


class EndpointRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    id: int
    kind: str
    node: int
    topic: str
    type_name: str
    type_hash: str
    gid: bytes
    qos: QoSProfile
    statistics: EndpointStatistics | None = None


class MatchRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    publisher: int
    subscription: int
    route: str = "socket"


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


FromClient = (
    Hello
    | Ping
    | Pong
    | DeclareType
    | CreateNode
    | DestroyNode
    | CreatePublisher
    | CreateSubscription
    | DestroyEndpoint
    | AssertLiveliness
    | Ack
    | Report
    | GetGraph
    | GetType
    | Observe
    | StopBroker
)
FromBroker = (
    Hello
    | Ping
    | Pong
    | Created
    | Done
    | Refused
    | Fault
    | Matched
    | Unmatched
    | Incompatible
    | LivelinessChanged
    | LivelinessLost
    | Dropped
    | Credit
    | Graph
    | GraphChanged
    | TypeDescription
)

_encode = msgspec.msgpack.Encoder().encode


def encode_frame(message: Message) -> bytes:
    """The whole control frame that carries `message`."""
    body = _encode(message)
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


class Decoder:
    """Decodes the control messages that one role may send; one for each role is enough."""

    def __init__(self, union: Any) -> None:
        self._decode = msgspec.msgpack.Decoder(union).decode

    def decode(self, body: bytes) -> Any:
        """Raises RemoteProtocolError, naming the field, where `body` is no message of that role."""
        try:
            return self._decode(body)
        except (ValueError, RecursionError) as error:  # msgspec's errors and bad UTF-8 are ValueErrors
            raise RemoteProtocolError(f"control message not understood: {error}") from None


from_client = Decoder(FromClient)
from_broker = Decoder(FromBroker)
