"""The route through shared memory: what processes share, who reads whose ring, and the way back.

Handlers of the broker's control messages, as in `busd.core.registry`. Descriptors are opaque here: the shell
has looked at them. Where some did not arrive (a process was out of descriptors), samples go by socket.
"""

import logging

from bus.base.ids import EndpointId
from bus.errors import QuotaExceeded, RemoteProtocolError
from bus.wire import messages as m
from busd.core.effects import Effect, Note, Send
from busd.core.entities import SOCKET, Peer, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.matching import release, reroute
from busd.core.quotas import Quotas
from busd.core.registry import Registry
from busd.core.router import Router
from busd.core.work import MATCH, TELL, Work


class Routes:
    """Carries out Share, Attach, RefuseRoute, LeaveRing, CaughtUp and ReplaceRing.

    What is said about a match that is gone, or that the other end has refused, is too late and no mistake.
    """

    def __init__(self, graph: Graph, quotas: Quotas, registry: Registry, router: Router) -> None:
        self._graph = graph
        self._quotas = quotas
        self._registry = registry
        self._router = router

    def share(
        self,
        now_ns: int,
        peer: Peer,
        message: m.Share,
        out: list[Effect],
        doorbell: object | None = None,
        readers: object | None = None,
    ) -> None:
        if peer.has_shared:
            raise RemoteProtocolError("a Share came a second time")
        peer.has_shared = True
        if doorbell is None:
            out.append(
                Note(logging.WARNING, f"{peer.describe()} shares no memory: its descriptors were lost")
            )
        elif self._may_hold(now_ns, peer, (doorbell, readers), out):
            peer.doorbell, peer.readers = doorbell, readers

    def attach(self, now_ns: int, peer: Peer, message: m.Attach, out: list[Effect]) -> None:
        subscription = self._registry.own_subscription(peer, message.subscription)
        publisher = subscription.matches.get(EndpointId(message.source))
        sharing = publisher.shared.get(subscription.id) if publisher is not None else None
        if publisher is None or sharing is None:
            return
        if sharing.is_attached:
            raise RemoteProtocolError(
                f"subscription {subscription.id} attached to publisher {publisher.id} a second time"
            )
        sharing.is_attached = True
        attached = m.Attached(
            publisher=publisher.id,
            subscription=subscription.id,
            slot=message.slot,
            process=peer.id,
            pid=peer.pid,
        )
        out.append(Send(publisher.node.peer.id, attached, (peer.readers, peer.doorbell)))

    def refuse(self, now_ns: int, peer: Peer, message: m.RefuseRoute, out: list[Effect]) -> None:
        endpoint = self._registry.own_endpoint(peer, message.endpoint)
        other = endpoint.matches.get(EndpointId(message.other))
        self._reroute_either(now_ns, endpoint, other, f"{peer.describe()}: {message.text}", out)

    def leave(self, now_ns: int, peer: Peer, message: m.LeaveRing, out: list[Effect]) -> None:
        subscription = self._registry.own_subscription(peer, message.subscription)
        publisher = subscription.matches.get(EndpointId(message.source))
        sharing = publisher.leaving.pop(subscription.id, None) if publisher is not None else None
        if publisher is not None and sharing is not None:
            # Received through the ring already: not sent again, and nobody waits for them.
            subscription.remember(publisher, message.seq)
            release(publisher, subscription, message.seq, out.append)
            told = m.Rerouted(
                endpoint=publisher.id,
                other=subscription.id,
                route=SOCKET,
                at_ns=sharing.at_ns,
                last_seq=message.seq,
            )
            out.append(Send(publisher.node.peer.id, told))

    def caught_up(self, now_ns: int, peer: Peer, message: m.CaughtUp, out: list[Effect]) -> None:
        publisher = self._registry.own_publisher(peer, message.publisher)
        subscription = publisher.matches.get(EndpointId(message.subscription))
        if subscription is not None and publisher.is_catching_up(subscription.id):
            self._graph.begin_routing(publisher, subscription)

    def replace_ring(
        self,
        now_ns: int,
        peer: Peer,
        message: m.ReplaceRing,
        out: list[Effect],
        ring: object | None = None,
    ) -> Work:
        publisher = self._registry.own_publisher(peer, message.publisher)
        publisher.ring = None  # first of all: the new one takes its place
        if ring is not None and self._may_hold(now_ns, peer, (ring,), out):
            publisher.ring = ring
        for subscription in [publisher.matches[one] for one in publisher.shared]:
            if subscription.id not in publisher.shared:
                continue
            if publisher.ring is None:
                self._reroute(now_ns, publisher, subscription, "its new ring was lost", out)
                now_ns = yield MATCH
            else:
                replaced = m.RingReplaced(subscription=subscription.id, source=publisher.id)
                out.append(Send(subscription.node.peer.id, replaced, (ring,)))
                now_ns = yield TELL

    def _may_hold(self, now_ns: int, peer: Peer, descriptors: tuple[object, ...], out: list[Effect]) -> bool:
        """Whether there is room for them; without room all goes by socket."""
        try:
            self._quotas.take_descriptors(peer, descriptors)
        except QuotaExceeded as error:
            self._quotas.refused(now_ns, peer, error, out)
            return False
        return True

    def _reroute_either(
        self,
        now_ns: int,
        endpoint: Publisher | Subscription,
        other: Publisher | Subscription | None,
        why: str,
        out: list[Effect],
    ) -> None:
        if isinstance(endpoint, Publisher) and isinstance(other, Subscription):
            self._reroute(now_ns, endpoint, other, why, out)
        elif isinstance(endpoint, Subscription) and isinstance(other, Publisher):
            self._reroute(now_ns, other, endpoint, why, out)

    def _reroute(
        self, now_ns: int, publisher: Publisher, subscription: Subscription, why: str, out: list[Effect]
    ) -> None:
        if subscription.id not in publisher.shared:
            return
        reroute(now_ns, self._graph, publisher, subscription, out)
        self._router.bound(now_ns, subscription)
        ends = f"{publisher.node.full_name} to {subscription.node.full_name}"
        out.append(
            Note(logging.WARNING, f"samples on '{publisher.topic.name}' from {ends} go by socket: {why}")
        )
