"""Nodes, endpoints and types come and go: the entities that a peer may make, under which limits and rules.

Handlers of the broker's control messages. A request that can't be carried out raises ConfigurationError,
QuotaExceeded or AccessDenied (the broker answers Refused); an id that is not the peer's own raises
RemoteProtocolError. Long tasks are Work, done in pieces. While an endpoint is being made, its process gets no
news of it (`Peer.withheld`): others know of it first.
"""

import logging
from collections import deque
from operator import attrgetter

from msgspec import structs

from bus import names
from bus.base.ids import EndpointId, NodeId
from bus.errors import ConfigurationError, RemoteProtocolError
from bus.qos import Durability, History, QoSProfile, check_offer
from bus.wire import messages as m
from bus.wire.answers import RefusedForNow
from bus.wire.runs import RunQueue
from busd.core.absent import Absentees, Steps
from busd.core.access_guard import AccessGuard
from busd.core.bridging import check_origin
from busd.core.effects import Effect, Note, Send
from busd.core.entities import (
    MessageType,
    Node,
    Peer,
    Publisher,
    Subscription,
    Topic,
    is_manual,
    keeps_history,
)
from busd.core.graph import Graph
from busd.core.history import PublisherHistory
from busd.core.leases import Leases
from busd.core.limits import TopicRule, rules_for
from busd.core.match import MatchState
from busd.core.matching import end_match, make_match
from busd.core.overload import Overload
from busd.core.places import Places
from busd.core.quotas import Quotas
from busd.core.router import Router
from busd.core.work import ENDPOINT, FRAME, RUNS_AT_ONCE, RUNS_PER_UNIT, UNMATCH, Work

_GID_BYTES = 16
_MAX_TYPE_NAME = 255
_IS_TAP = attrgetter("is_tap")
_IS_OF_TAP = attrgetter("subscription.is_tap")
_OF_EVERY_NODE = frozenset({"/rosout", "/parameter_events"})
"""No program chooses their depth, nor the depth of parameter services: a lower limit caps it instead of
refusing.
"""


class Registry:
    """Carries out Create..., Destroy... and DeclareType on the graph."""

    def __init__(  # noqa: PLR0913
        self,
        graph: Graph,
        quotas: Quotas,
        rules: tuple[TopicRule, ...],
        leases: Leases,
        router: Router,
        overload: Overload,
        access_guard: AccessGuard,
        absentees: Absentees,
        places: Places,
    ) -> None:
        self._graph = graph
        self._quotas = quotas
        self.rules = rules
        self._leases = leases
        self._router = router
        self._overload = overload
        self._access_guard = access_guard
        self._absentees = absentees
        self._places = places

    def declare_type(self, now_ns: int, peer: Peer, message: m.DeclareType, out: list[Effect]) -> None:
        for text in (message.type_name, message.type_hash):
            if not 0 < len(text) <= _MAX_TYPE_NAME:
                raise RemoteProtocolError(
                    f"type name or hash of {len(text)} characters, the limit is {_MAX_TYPE_NAME}"
                )
            if not text.isprintable():  # it is shown on terminals and in logs
                raise RemoteProtocolError(f"type name or hash {text!r}, which can't be printed")
        kind = (message.type_name, message.type_hash)
        if kind in peer.types:
            return
        peer.refused_types.pop(kind, None)
        self._quotas.check_type(peer)
        size, most = len(message.schema), self._quotas.limits.schema_bytes
        if size > most:  # this message has no answer: an endpoint of the type is refused with this text
            peer.refused_types[kind] = (
                f"the schema of {message.type_name} has {size} bytes, the limit is {most}; "
                "in busd.toml it is schema_bytes of [limits]"
            )
            return
        is_trusted = self._access_guard.access.is_free(peer.uid)
        self._graph.types.add(peer, kind, message.schema, is_trusted=is_trusted)

    def create_node(self, now_ns: int, peer: Peer, message: m.CreateNode, out: list[Effect]) -> None:
        names.validate_node_name(message.name)
        names.validate_namespace(message.namespace)
        self._quotas.check_node(peer)
        if message.origin is not None:
            check_origin(message.origin)
            peer.is_bridge = True
        node = Node(
            NodeId(self._graph.next_id()), peer, message.name, message.namespace, origin=message.origin
        )
        other = self._graph.node_named(node.full_name)
        self._graph.add_node(node)
        out.append(Send(peer.id, m.Created(request=message.request, id=node.id)))
        if other is not None and (node.origin is None or other.origin is None):
            text = f"there is more than one node named {node.full_name}"
            processes = dict.fromkeys((other.peer.describe(), peer.describe()))
            out.append(Note(logging.WARNING, f"{text}: {' and '.join(processes)}"))
            _introduce(node, other, out)
            _introduce(other, node, out)

    def destroy_node(self, now_ns: int, peer: Peer, message: m.DestroyNode, out: list[Effect]) -> Work:
        return self.remove_node(self._own_node(peer, message.node), out)

    def remove_node(self, node: Node, out: list[Effect], *, is_lost: bool = False) -> Work:
        """Take `node` with its endpoints out of the graph. `is_lost`: its process ended without a goodbye."""
        endpoints = deque(node.endpoints.values())
        while endpoints:  # one by one: to free thousands at once takes milliseconds
            endpoint = endpoints.popleft()
            if endpoint.id in node.endpoints:
                yield from self._remove_endpoint(endpoint, out, is_lost=is_lost)
        self._graph.remove_node(node)

    def create_publisher(
        self,
        now_ns: int,
        peer: Peer,
        message: m.CreatePublisher,
        out: list[Effect],
        ring: object | None = None,
    ) -> Work:
        if peer.is_bridge:
            now_ns = yield from self._free_gid(now_ns, peer, message.stands_for or message.gid, out)
        node, topic, kind, qos, max_message_bytes = self._check_endpoint(now_ns, peer, message, out)
        if ring is not None:
            self._quotas.take_descriptors(peer, (ring,))
        depth = _depth(qos)
        publisher = Publisher(
            id=EndpointId(self._graph.next_id()),
            node=node,
            topic=topic,
            type=kind,
            gid=self._access_guard.gid(peer, message.gid),
            qos=qos,
            max_message_bytes=max_message_bytes,
            next_seq=message.next_seq,
            # Its samples are stamped by its own clock.
            lifespan_ns=qos.lifespan_ns and (qos.lifespan_ns - peer.clock_ns or 1),
            lease_ns=qos.lease_ns,
            is_manual=is_manual(qos),
            last_sign_ns=now_ns,
            history=PublisherHistory(depth, peer.history) if keeps_history(qos) else None,
            credited=message.next_seq - 1,
            ring=ring,
            places=set(message.places),
            stands_for=self._access_guard.gid(peer, message.stands_for) if message.stands_for else b"",
        )
        if message.descriptors and ring is None:
            lost = f"{node.full_name} shares no memory on '{message.topic}': its ring was lost"
            out.append(Note(logging.WARNING, lost))
        subscriptions = topic.subscriptions
        # A pair is matched by the endpoint that comes later, once. Taps come last: when a bridge learns of a
        # tap's match, it may find samples in the ring. It drops them without the match of a mirror.
        there = sorted(subscriptions.values(), key=_IS_TAP)
        self._graph.add_endpoint(publisher)
        self._absentees.come(publisher)
        out.append(Send(peer.id, self._created(message.request, publisher, depth)))
        self._leases.watch_publisher(now_ns, publisher)
        peer.withheld = publisher.id
        now_ns = yield ENDPOINT
        for subscription in there:
            if subscription.id in subscriptions:
                price = make_match(now_ns, self._graph, publisher, subscription, out)
                self._absentees.matched(publisher, subscription)
                now_ns = yield price

    def create_subscription(
        self, now_ns: int, peer: Peer, message: m.CreateSubscription, out: list[Effect]
    ) -> Work:
        if peer.is_bridge:
            now_ns = yield from self._free_gid(now_ns, peer, message.gid, out)
        node, topic, kind, qos, max_message_bytes = self._check_endpoint(now_ns, peer, message, out)
        number, depth = EndpointId(self._graph.next_id()), _depth(qos)
        subscription = Subscription(
            id=number,
            node=node,
            topic=topic,
            type=kind,
            gid=self._access_guard.gid(peer, message.gid),
            qos=qos,
            max_message_bytes=max_message_bytes,
            queue=RunQueue(depth, peer.queued, number),
            last_seqs=message.last_seqs,
            takes_history=message.takes_history or keeps_history(qos),
            local_only=message.local_only,
            is_mirror=message.role == "mirror",
            is_tap=message.role == "tap",
        )
        publishers = topic.publishers
        there = tuple(publishers.values())
        self._graph.add_endpoint(subscription)
        out.append(Send(peer.id, self._created(message.request, subscription, depth)))
        peer.withheld = subscription.id
        now_ns = yield ENDPOINT
        now_ns = yield from self._absentees.find(now_ns, subscription, out)
        for publisher in there:
            if publisher.id in publishers:
                now_ns = yield make_match(now_ns, self._graph, publisher, subscription, out)
        now_ns = yield from self._absentees.settle(now_ns, subscription, out)
        subscription.forget_oldest()
        if subscription.queue.runs:
            self._overload.bound(now_ns, subscription)

    def destroy_endpoint(
        self, now_ns: int, peer: Peer, message: m.DestroyEndpoint, out: list[Effect]
    ) -> Work:
        return self._remove_endpoint(self.own_endpoint(peer, message.endpoint), out)

    def own_endpoint(self, peer: Peer, number: int) -> Publisher | Subscription:
        """The peer's endpoint with that id; RemoteProtocolError if it has none."""
        endpoint = peer.endpoints.get(EndpointId(number))
        if endpoint is None:
            raise RemoteProtocolError(f"endpoint {number} is not one of yours")
        return endpoint

    def own_publisher(self, peer: Peer, number: int) -> Publisher:
        endpoint = self.own_endpoint(peer, number)
        if not isinstance(endpoint, Publisher):
            raise RemoteProtocolError(f"endpoint {number} is not a publisher")
        return endpoint

    def own_subscription(self, peer: Peer, number: int) -> Subscription:
        endpoint = self.own_endpoint(peer, number)
        if not isinstance(endpoint, Subscription):
            raise RemoteProtocolError(f"endpoint {number} is not a subscription")
        return endpoint

    def _own_node(self, peer: Peer, number: int) -> Node:
        node = peer.nodes.get(NodeId(number))
        if node is None:
            raise RemoteProtocolError(f"node {number} is not one of yours")
        return node

    def _remove_endpoint(
        self, endpoint: Publisher | Subscription, out: list[Effect], *, is_lost: bool = False
    ) -> Work:
        self._graph.withdraw(endpoint)
        now_ns = endpoint.node.peer.last_heard_ns
        if isinstance(endpoint, Publisher):
            endpoint.has_left = not is_lost
            gap = 0 if is_lost else endpoint.conclude()
            self._absentees.go(endpoint)
            # Taps first: a bridge keeps waiting messages of a publisher that its tap no longer matches.
            for match in sorted(endpoint.matches.values(), key=_IS_OF_TAP, reverse=True):
                if not match.has_ended:
                    self._router.settle(now_ns, match)
                    if is_lost:
                        self._places.await_repeated(now_ns, match)
                    else:
                        self._router.give_up_repeated(now_ns, match)
                    if gap and match.state is MatchState.ROUTED:
                        self._router.miss(now_ns, endpoint, gap, (match.subscription,), is_loss=False)
                    end_match(self._graph, match, out, is_lost=is_lost)
                    now_ns = yield UNMATCH
            if endpoint.history is not None:
                yield from _empty(endpoint.history)
            endpoint.ring = None  # a timer may still know the publisher
            endpoint.node.peer.lapsed.discard(endpoint)
        else:
            if is_lost:
                now_ns = yield 0
                now_ns = yield from self._absentees.lose(now_ns, endpoint)
            self._absentees.forget(endpoint)
            for match in tuple(endpoint.matches.values()):
                if not match.has_ended:
                    keep_ns = self._places.keep(now_ns, match) if is_lost else 0
                    end_match(self._graph, match, out, is_lost=is_lost, keep_ns=keep_ns)
                    now_ns = yield UNMATCH
            yield from _empty(endpoint.queue)
            endpoint.node.peer.perishable.discard(endpoint)
        if endpoint.id in endpoint.node.endpoints:
            self._graph.remove_endpoint(endpoint)
        yield ENDPOINT

    def _free_gid(self, now_ns: int, peer: Peer, gid: bytes, out: list[Effect]) -> Steps:
        """Raises RefusedForNow if an endpoint has that gid: only one bridge may mirror an endpoint.

        Endpoints of a process that has gone are removed first: a bridge may be back.
        """
        other = self._graph.endpoint_with(self._access_guard.gid(peer, gid))
        if other is None:
            return now_ns
        if not other.node.peer.has_gone:
            origin = other.node.origin
            way = "" if origin is None else f", brought from {origin.bus} by bridge {origin.bridge}"
            raise RefusedForNow(
                f"gid {gid.hex()} is on this bus already: "
                f"{other.kind} of {other.node.full_name} on '{other.topic.name}'{way}"
            )
        yield from self._remove_endpoint(other, out, is_lost=True)
        return (yield FRAME)

    def _check_endpoint(
        self,
        now_ns: int,
        peer: Peer,
        message: m.CreatePublisher | m.CreateSubscription,
        out: list[Effect],
    ) -> tuple[Node, Topic, MessageType, QoSProfile, int]:
        """Check the request. Returns node, topic, type, the QoS under the rules, and the largest message."""
        node = self._own_node(peer, message.node)
        topic = self._graph.topics.get(message.topic)
        if topic is None:  # else its name was looked at already
            names.validate_full_topic_name(message.topic)
            topic = Topic(message.topic)
        does_publish = isinstance(message, m.CreatePublisher)
        stands_for = message.stands_for if isinstance(message, m.CreatePublisher) else b""
        for gid in (message.gid, stands_for or message.gid):
            if len(gid) != _GID_BYTES:
                raise RemoteProtocolError(f"gid of {len(gid)} bytes, a gid has {_GID_BYTES}")
        # Before the limits: their texts depend on present endpoints, also of a hidden topic.
        self._access_guard.admit(node, "publish" if does_publish else "subscribe", topic.name, out)
        matches = len(topic.subscriptions if does_publish else topic.publishers)
        if not peer.is_guest:
            matches -= topic.guest_subscriptions if does_publish else topic.guest_publishers
        self._quotas.check_endpoint(now_ns, peer, topic.name, self._graph.topics, matches)
        kind = (message.type_name, message.type_hash)
        if kind not in peer.types:
            if reason := peer.refused_types.get(kind):
                raise ConfigurationError(reason)
            self._quotas.check_type(peer)  # then it was declared, and there was no room for it
            raise RemoteProtocolError(f"type {message.type_name} was not declared on this connection")
        if message.qos.durability is Durability.BEST_AVAILABLE:
            check_offer(message.qos)  # subscriptions say `takes_history`
        limits, caps = self._quotas.limits, rules_for(topic.name, self.rules)
        qos = _within(limits.depth, topic.name, caps.cap(message.qos))
        return node, topic, kind, qos, caps.max_message_bytes or limits.message_bytes

    def _created(self, request: int, endpoint: Publisher | Subscription, depth: int) -> m.Created:
        limits = self._quotas.limits
        return m.Created(
            request=request,
            id=endpoint.id,
            depth=depth,
            max_message_bytes=endpoint.max_message_bytes,
            window_samples=limits.keep_all_window_messages,
            window_bytes=limits.keep_all_window_bytes,
            ring_bytes=limits.ring_bytes,
        )


def _introduce(node: Node, other: Node, out: list[Effect]) -> None:
    """Tell the process of `node` once that `other` has the same name, if it may see `other`."""
    mine, its = node.peer, other.peer
    # The same process may come back by another connection before busd saw the old one end.
    is_back = mine is not its and mine.process == its.process
    may_hear = mine.hears_of_namesakes and node.origin is None and (mine.uid == its.uid or not mine.is_guest)
    if may_hear and not is_back and not node.knows_namesake:
        node.knows_namesake = True
        program, origin = its.program, other.origin
        if origin is not None:
            program = f"{program}, which has brought it from {origin.home}"
        out.append(Send(mine.id, m.Namesake(node=node.id, pid=its.pid, program=program)))


def _within(most: int, topic: str, qos: QoSProfile) -> QoSProfile:
    """`qos` within depth `most`. ConfigurationError if a program chose a larger depth."""
    if qos.history is not History.KEEP_LAST or qos.depth <= most:
        return qos
    if topic in _OF_EVERY_NODE or names.service_of_topic(topic) is not None:
        return structs.replace(qos, depth=most)
    raise ConfigurationError(f"depth {qos.depth} is more than busd's limit of {most}")


def _depth(qos: QoSProfile) -> int:
    return qos.depth if qos.history is History.KEEP_LAST else 0


def _empty(queue: RunQueue) -> Work:
    """Drop the queue of an endpoint that is gone. It may have a million runs of one sample."""
    while queue.drop(RUNS_AT_ONCE):
        yield RUNS_AT_ONCE // RUNS_PER_UNIT
