"""The route through shared memory: what processes share, who reads whose ring, and the way back.

Handlers of the broker's control messages, as in `busd.core.declaring`. Descriptors are opaque here: the shell
has looked at them. Where some did not arrive (a process was out of descriptors), samples go by socket.
"""

import logging

from bus.errors import RemoteProtocolError
from bus.ids import EndpointId
from bus.wire import messages as m
from busd.core.declaring import Registrar
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Peer, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.matching import reroute
from busd.core.routing import Router


class Routes:
    """Carries out Share, Attach, RefuseRoute, CaughtUp and ReplaceRing.

    What is said about a match that is gone, or that the other end has refused, is too late and no mistake.
    """

    def __init__(self, graph: Graph, registrar: Registrar, router: Router) -> None:
        self._graph = graph
        self._registrar = registrar
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
        peer.doorbell, peer.readers = doorbell, readers
        if doorbell is None:
            out.append(
                Note(logging.WARNING, f"{peer.describe()} shares no memory: its descriptors were lost")
            )

    def attach(self, now_ns: int, peer: Peer, message: m.Attach, out: list[Effect]) -> None:
        subscription = self._registrar.own_subscription(peer, message.subscription)
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
        endpoint = self._registrar.own_endpoint(peer, message.endpoint)
        other = endpoint.matches.get(EndpointId(message.other))
        if isinstance(endpoint, Publisher) and isinstance(other, Subscription):
            self._reroute(now_ns, endpoint, other, f"{peer.describe()}: {message.text}", out)
        elif isinstance(endpoint, Subscription) and isinstance(other, Publisher):
            self._reroute(now_ns, other, endpoint, f"{peer.describe()}: {message.text}", out)

    def caught_up(self, now_ns: int, peer: Peer, message: m.CaughtUp, out: list[Effect]) -> None:
        publisher = self._registrar.own_publisher(peer, message.publisher)
        subscription = publisher.matches.get(EndpointId(message.subscription))
        if subscription is not None and subscription.id not in publisher.shared:
            publisher.routed[subscription.id] = subscription

    def replace_ring(
        self,
        now_ns: int,
        peer: Peer,
        message: m.ReplaceRing,
        out: list[Effect],
        ring: object | None = None,
    ) -> None:
        publisher = self._registrar.own_publisher(peer, message.publisher)
        publisher.ring = ring
        for subscription in [publisher.matches[one] for one in publisher.shared]:
            if ring is None:
                self._reroute(now_ns, publisher, subscription, "its new ring was lost", out)
            else:
                replaced = m.RingReplaced(subscription=subscription.id, source=publisher.id)
                out.append(Send(subscription.node.peer.id, replaced, (ring,)))

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
