"""One connection of a client from busd's side: the answers to its messages, and the first broken rule.

Owns the rules of docs/protocol.md that a frame alone does not show: which ids, numbers, names and types a
client may use when. Frames and fields were checked before (`bus.wire.session`). Must not know sockets and
clocks.
"""

import hashlib
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from bus import names
from bus.base.counted import counted
from bus.errors import BusError
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, RECORD_HEAD
from bus.wire.runs import Run
from bus_cli.doctor.conformance import payloads

__all__ = ["KEEP_ALL", "USUAL", "Conversation", "Endpoint", "LeftOut", "Terms", "Wrong", "is_plain"]

GID_BYTES = 16
_MOST_PAYLOADS = 1000
_AHEAD_NS = 100_000_000
"""How far a stamp may be ahead: another processor may have a slightly different view of the clock."""
_PLUMBING = ("/rosout", "/parameter_events")

KEEP_ALL = "Keep all"
_FRAMES, _TYPES = "Frames", "Types and payloads"
"""Sections of docs/protocol.md."""


class Wrong(Exception):
    """The client has done something wrong.

    `section`: the one of docs/protocol.md to read, if it is not that of the story.
    """

    def __init__(self, text: str, section: str = "") -> None:
        super().__init__(text)
        self.section = section


class LeftOut(Exception):
    """The story says nothing about this client."""


class Terms(NamedTuple):
    """Terms of busd for endpoints on topics of users. The other endpoints have the defaults."""

    refuses: str = ""
    """The text with which busd refuses each; empty: it creates them."""
    max_message_bytes: int = 1 << 20
    window_samples: int = 1 << 16
    gives_credit: bool = True
    """Whether a lossless publisher gets credit at once."""


USUAL = Terms()


class Endpoint(msgspec.Struct, eq=False):
    """An endpoint of the client, and the one endpoint on the other side that it matches."""

    id: int
    is_publisher: bool
    topic: str
    schema: MessageSchema
    qos: QoSProfile
    gid: bytes
    node: int
    partner: int
    """The id of the endpoint on the other side."""
    terms: Terms = USUAL
    partners: int = 1
    """How many endpoints it has matched, one after the other."""
    next_seq: int = 1
    last_seqs: dict[bytes, int] = {}
    samples: int = 0
    """Published by it, or sent to it."""
    last_seq: int = 0
    """Number of the last sample published by it, or sent to it."""
    stamp_ns: int = 0
    acknowledged: int = 0
    credit: int = 0
    """Number of the last sample for which it has credit."""
    payloads: deque[bytes] = msgspec.field(default_factory=lambda: deque(maxlen=_MOST_PAYLOADS))
    """The last payloads that it published."""

    def __str__(self) -> str:
        return f"{'publisher' if self.is_publisher else 'subscription'} {self.id} on {self.topic}"

    @property
    def partner_gid(self) -> bytes:
        """The same after a restart."""
        return gid_of_partner(self.topic, self.partners)


class Conversation:
    """The declarations and samples of one connection; raises Wrong at the first broken rule.

    Its ids begin at `first_id`. `started_ns`: no sample is older.
    """

    def __init__(self, first_id: int, started_ns: int, terms: Terms) -> None:
        self._started_ns = started_ns
        self._next_id = first_id
        self._terms = terms
        self._requests: set[int] = set()
        self._types: dict[tuple[str, str], MessageSchema] = {}
        self._has_shared = False
        self.nodes: dict[int, str] = {}
        self.endpoints: dict[int, Endpoint] = {}
        self.declared = 0
        """Number of messages that declared something."""
        self.heard = 0
        """Number of messages and runs."""
        self.refused = 0

    def plain(self, *, publishers: bool) -> list[Endpoint]:
        """Its publishers or subscriptions on topics of users."""
        found = self.endpoints.values()
        return [one for one in found if one.is_publisher is publishers and is_plain(one.topic)]

    def hear(self, item: Any, now_ns: int) -> list[m.Message]:
        """Take a message or a run, and return the answers."""
        self.heard += 1
        match item:
            case Run():
                return list(self._publish(item, now_ns))
            case m.Ping(number=number):
                return [m.Pong(number=number)] if number else []
            case m.DeclareType():
                self._declare_type(item)
            case m.CreateNode():
                return [self._create_node(item)]
            case m.CreatePublisher() | m.CreateSubscription():
                return self._create_endpoint(item)
            case m.DestroyNode(node=node):
                self._own_node("DestroyNode", node)
                del self.nodes[node]
                self.endpoints = {one.id: one for one in self.endpoints.values() if one.node != node}
            case m.DestroyEndpoint(endpoint=endpoint):
                self._own("DestroyEndpoint", endpoint)
                del self.endpoints[endpoint]
            case m.AssertLiveliness(publisher=number):
                self._own("AssertLiveliness", number, is_publisher=True)
            case m.ReplaceRing(publisher=number):
                self._own("ReplaceRing", number, is_publisher=True)
            case m.Report(endpoint=number):
                self._own("Report", number)
            case m.Ack():
                self._acknowledge(item)
            case m.Share():
                self._share()
            case m.Attach() | m.LeaveRing() | m.CaughtUp():
                kind = type(item).__name__
                raise Wrong(f"{kind} came, but all matches have the route socket and were never rerouted")
            case m.GetGraph(request=request) | m.Observe(request=request):
                self._use(request)
                return [m.GraphSnapshot(request=request, revision=1, nodes=(), endpoints=(), matches=())]
            case m.GetType() | m.GetPeers() | m.StopBroker() | m.Reload():
                self._use(item.request)
                return [m.Refused(request=item.request, text="this busd only tests its client")]
        return []

    def feed(self, endpoint: Endpoint, bodies: list[bytes], stamp_ns: int) -> bytes:
        """A data frame for a subscription, with these payloads as the next samples of its publisher."""
        records = b"".join(RECORD_HEAD.pack(len(body), stamp_ns) + body for body in bodies)
        first, count = endpoint.last_seq + 1, len(bodies)
        endpoint.samples += count
        endpoint.last_seq += count
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(records)
        head = DATA_HEAD.pack(length, DATA, 0, 0, endpoint.id, endpoint.partner, first, count, 0)
        return head + records

    def replace_partner(self, endpoint: Endpoint) -> list[m.Message]:
        """The match ends, and another endpoint, with another gid, matches: the messages about both."""
        last_seq = 0 if endpoint.is_publisher else endpoint.last_seq
        unmatched = m.Unmatched(endpoint=endpoint.id, other=endpoint.partner, last_seq=last_seq)
        endpoint.partner = self._new_id()
        endpoint.partners += 1
        if not endpoint.is_publisher:
            endpoint.last_seq = endpoint.acknowledged = 0
        return [unmatched, self._matched(endpoint)]

    def give_credit(self, endpoint: Endpoint) -> m.Message:
        """Credit for everything that a publisher has sent."""
        endpoint.credit = endpoint.last_seq
        return m.Credit(publisher=endpoint.id, seq=endpoint.credit)

    # --- rules

    def _new_id(self) -> int:
        self._next_id += 1
        return self._next_id - 1

    def _use(self, request: int) -> None:
        if request in self._requests:
            raise Wrong(f"request {request} came twice; each request of a connection has its own number")
        self._requests.add(request)

    def _own_node(self, kind: str, node: int) -> None:
        if node not in self.nodes:
            raise Wrong(f"{kind} names node {node}; its nodes are {_listed(self.nodes)} (from Created)")

    def _own(self, kind: str, number: int, *, is_publisher: bool | None = None) -> Endpoint:
        found = self.endpoints.get(number)
        if found is None or is_publisher not in (None, found.is_publisher):
            kinds = {None: "endpoints", True: "publishers", False: "subscriptions"}[is_publisher]
            ids = [one.id for one in self.endpoints.values() if is_publisher in (None, one.is_publisher)]
            raise Wrong(f"{kind} names {number}; its {kinds} are {_listed(ids)} (from Created)")
        return found

    def _declare_type(self, message: m.DeclareType) -> None:
        name, told = message.type_name, message.type_hash
        schema = MessageSchema(name, told, message.schema)
        self.declared += 1
        if message.schema != payloads.NOTHING:
            try:
                computed = MessageSchema.of(schema.description)
            except (BusError, ValueError, TypeError, KeyError) as error:
                raise Wrong(f"DeclareType of {name} has a bad schema: {error}", _TYPES) from None
            if computed.type_hash != told:
                text = f"DeclareType of {name} says {told}; its schema has {computed.type_hash}"
                raise Wrong(text, _TYPES)
            if computed.type_name != name:
                raise Wrong(f"DeclareType of {name} has the schema of {computed.type_name}", _TYPES)
        self._types[name, told] = schema

    def _create_node(self, message: m.CreateNode) -> m.Message:
        self._use(message.request)
        self.declared += 1
        try:
            names.validate_node_name(message.name)
            names.validate_namespace(message.namespace)
        except BusError as error:
            raise Wrong(f"CreateNode: {_one_line(error)}") from None
        number = self._new_id()
        self.nodes[number] = names.join_node_name(message.namespace, message.name)
        return m.Created(request=message.request, id=number)

    def _create_endpoint(self, message: m.CreatePublisher | m.CreateSubscription) -> list[m.Message]:
        kind, is_publisher = type(message).__name__, isinstance(message, m.CreatePublisher)
        self._use(message.request)
        self.declared += 1
        self._own_node(kind, message.node)
        try:
            names.validate_full_topic_name(message.topic)
        except BusError as error:
            raise Wrong(f"{kind}: {_one_line(error)}") from None
        if len(message.gid) != GID_BYTES:
            raise Wrong(
                f"{kind} on {message.topic} has a gid of {len(message.gid)} bytes; it has {GID_BYTES}"
            )
        twin = next((one for one in self.endpoints.values() if one.gid == message.gid), None)
        if twin is not None:
            raise Wrong(f"{kind} on {message.topic} has the gid of {twin}; each endpoint has its own")
        schema = self._types.get((message.type_name, message.type_hash))
        if schema is None:
            name = f"{message.type_name} with {message.type_hash}"
            raise Wrong(f"{kind} on {message.topic} comes without a DeclareType of {name} before it")
        terms = self._terms if is_plain(message.topic) else USUAL
        if terms.refuses:
            self.refused += 1
            return [m.Refused(request=message.request, text=terms.refuses)]
        one = Endpoint(
            id=self._new_id(),
            is_publisher=is_publisher,
            topic=message.topic,
            schema=schema,
            qos=message.qos,
            gid=message.gid,
            node=message.node,
            partner=self._new_id(),
            terms=terms,
        )
        if isinstance(message, m.CreatePublisher):
            one.next_seq = message.next_seq
            one.last_seq = one.credit = message.next_seq - 1
        else:
            one.last_seqs = message.last_seqs
            one.last_seq = message.last_seqs.get(one.partner_gid, 0)
        self.endpoints[one.id] = one
        return [self._created(message.request, one), self._matched(one)]

    def _created(self, request: int, one: Endpoint) -> m.Message:
        depth = 0 if one.qos.history == "keep_all" else one.qos.depth
        return m.Created(
            request=request,
            id=one.id,
            depth=depth,
            max_message_bytes=one.terms.max_message_bytes,
            window_samples=one.terms.window_samples,
            window_bytes=4 << 20,
            ring_bytes=64 << 20,
        )

    def _matched(self, one: Endpoint) -> m.Message:
        return m.Matched(
            endpoint=one.id,
            other=one.partner,
            node="/conformance",
            gid=one.partner_gid,
            qos=one.qos,
            next_seq=one.last_seq + 1,
        )

    def _share(self) -> None:
        if self._has_shared:
            raise Wrong("Share came twice")
        if self.endpoints:
            raise Wrong("Share came after the first endpoint; it comes before")
        self._has_shared = True

    def _acknowledge(self, ack: m.Ack) -> None:
        one = self._own("Ack", ack.subscription, is_publisher=False)
        if ack.source != one.partner:
            text = f"Ack names source {ack.source}; the publisher of {one} is {one.partner}"
            raise Wrong(text, KEEP_ALL)
        if ack.seq > one.last_seq:
            raise Wrong(f"Ack of sample {ack.seq}; {one} got samples up to {one.last_seq}", KEEP_ALL)
        one.acknowledged = max(one.acknowledged, ack.seq)

    def _publish(self, run: Run, now_ns: int) -> Iterator[m.Message]:
        one = self._own("a data frame", run.endpoint, is_publisher=True)
        if run.only_for:
            raise Wrong(f"a data frame of {one} is for subscription {run.only_for} only; nobody asked for it")
        if run.first_seq <= one.last_seq:
            least = f"at least {one.last_seq + 1}"
            raise Wrong(f"{one} sent sample {run.first_seq}; its next number is {least}")
        if not run.is_whole:
            raise Wrong(_misfit(one, run), _FRAMES)
        for seq, (payload, stamp_ns) in enumerate(run.records(), run.first_seq):
            self._check_sample(one, seq, bytes(payload), stamp_ns, now_ns)
        one.last_seq = run.first_seq + run.count - 1
        if one.qos.is_lossless:
            window = one.terms.window_samples
            if one.last_seq - one.credit > window:
                text = f"its credit is {one.credit}, and window_samples of Created is {window}"
                raise Wrong(f"{one} sent sample {one.last_seq}; {text}")
            if one.terms.gives_credit:
                yield self.give_credit(one)

    def _check_sample(self, one: Endpoint, seq: int, payload: bytes, stamp_ns: int, now_ns: int) -> None:
        what = f"sample {seq} of {one}"
        most = one.terms.max_message_bytes
        if len(payload) > most:
            raise Wrong(f"{what} has {len(payload)} bytes; max_message_bytes of Created is {most}")
        if stamp_ns > now_ns + _AHEAD_NS:
            ahead_s = (stamp_ns - now_ns) / 1e9
            raise Wrong(f"{what} is stamped {ahead_s:.1f} s in the future; stamps are CLOCK_MONOTONIC")
        if stamp_ns < self._started_ns:
            early_s = (self._started_ns - stamp_ns) / 1e9
            text = f"is stamped {early_s:.1f} s before the client's start; stamps are CLOCK_MONOTONIC in ns"
            raise Wrong(f"{what} {text}")
        if stamp_ns < one.stamp_ns:
            raise Wrong(f"{what} is stamped before the sample ahead of it")
        if (fault := payloads.fault(one.schema, payload)) is not None and not _is_question(one, payload):
            raise Wrong(f"{what} is no {one.schema.type_name}: {fault}", _TYPES)
        one.stamp_ns = stamp_ns
        one.samples += 1
        one.payloads.append(payload)


def _misfit(one: Endpoint, run: Run) -> str:
    """How the records of a run do not fill its frame."""
    body = memoryview(run.body)
    for number in range(1, run.count + 1):
        if len(body) < RECORD_HEAD.size:
            return f"a data frame of {one} has no record {number}; its `count` is {run.count}"
        (size, _), body = RECORD_HEAD.unpack_from(body), body[RECORD_HEAD.size :]
        if size > len(body):
            text = f"record {number} of {run.count} in a data frame of {one} claims {size} bytes"
            return f"{text}; the frame has {len(body)} more"
        body = body[size:]
    return f"a data frame of {one} has {len(body)} bytes behind its {counted(run.count, 'record')}"


def is_plain(topic: str) -> bool:
    """Whether the topic is one of users, and not of services, logs or parameters."""
    return topic not in _PLUMBING and not names.is_hidden_topic(topic)


def _is_question(one: Endpoint, payload: bytes) -> bool:
    """Whether it is a client's question about a call: a request without a body."""
    service = names.service_of_topic(one.topic)
    if service is None or one.topic != names.request_topic(service):
        return False
    try:
        msgspec.msgpack.decode(payload, type=tuple[bytes, int, None])
    except msgspec.MsgspecError:
        return False
    return True


def gid_of_partner(topic: str, number: int = 1) -> bytes:
    """The gid of an endpoint on the other side, the first one or a later one."""
    return hashlib.blake2b(f"{number} {topic}".encode(), digest_size=GID_BYTES).digest()


def _listed(ids: Any) -> str:
    return ", ".join(map(str, ids)) or "none"


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())
