"""The route through shared memory: descriptors that processes share, rings that they read, and the way back.

Handlers of the broker's control messages, as in `busd.core.registry`. Descriptors are opaque here: the shell
has looked at them. If some did not arrive (a process was out of descriptors), samples go by socket.
"""

import logging

from bus.base.ids import EndpointId
from bus.errors import QuotaExceeded, RemoteProtocolError
from bus.vocabulary import Route
from bus.wire import messages as m
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Match, Peer
from busd.core.graph import Graph
from busd.core.match import MatchEvent, MatchState
from busd.core.matching import release, reroute
from busd.core.overload import Overload
from busd.core.quotas import Quotas
from busd.core.registry import Registry
from busd.core.router import Router
from busd.core.work import LOOKS_PER_UNIT, MATCH, TELL, Work


class Routes:
    """Carries out Share, Attach, RefuseRoute, LeaveRing, CaughtUp and ReplaceRing.

    A message about a match that is gone, or that the other end has refused, is only late, and no mistake.
    """

    def __init__(
        self, graph: Graph, quotas: Quotas, registry: Registry, router: Router, overload: Overload
    ) -> None:
        self._graph = graph
        self._quotas = quotas
        self._registry = registry
        self._router = router
        self._overload = overload

    def share(
        self,
        now_ns: int,
        peer: Peer,
        message: m.Share,
        out: list[Effect],
        doorbell: object | None = None,
        readers: object | None = None,
    ) -> None:
        if peer.has_sent_share:
            raise RemoteProtocolError("a Share came a second time")
        peer.has_sent_share = True
        if doorbell is None:
            out.append(
                Note(logging.WARNING, f"{peer.describe()} shares no memory: its descriptors were lost")
            )
        elif self._may_hold(now_ns, peer, (doorbell, readers), out):
            peer.doorbell, peer.readers = doorbell, readers

    def attach(self, now_ns: int, peer: Peer, message: m.Attach, out: list[Effect]) -> None:
        subscription = self._registry.own_subscription(peer, message.subscription)
        match = subscription.matches.get(EndpointId(message.source))
        if match is None or not match.is_shared:
            return
        publisher = match.publisher
        if match.state is MatchState.ATTACHED:
            raise RemoteProtocolError(
                f"subscription {subscription.id} attached to publisher {publisher.id} a second time"
            )
        match.on(MatchEvent.ATTACH)
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
        match = endpoint.matches.get(EndpointId(message.other))
        if match is not None:
            self._reroute(now_ns, match, f"{peer.describe()}: {message.text}", out)

    def leave(self, now_ns: int, peer: Peer, message: m.LeaveRing, out: list[Effect]) -> None:
        subscription = self._registry.own_subscription(peer, message.subscription)
        match = subscription.matches.get(EndpointId(message.source))
        if match is not None and match.state is MatchState.LEAVING:
            match.on(MatchEvent.LEAVE)
            publisher = match.publisher
            # Received through the ring already: not sent again, and not waited for.
            subscription.remember(publisher, message.seq)
            release(match, message.seq, out.append)
            told = m.Rerouted(
                endpoint=publisher.id,
                other=subscription.id,
                route=Route.SOCKET,
                at_ns=publisher.node.peer.by_its_clock(match.at_ns),
                last_seq=message.seq,
            )
            out.append(Send(publisher.node.peer.id, told))

    def caught_up(self, now_ns: int, peer: Peer, message: m.CaughtUp, out: list[Effect]) -> None:
        publisher = self._registry.own_publisher(peer, message.publisher)
        match = publisher.matches.get(EndpointId(message.subscription))
        if match is not None and match.state is MatchState.CATCHING_UP:
            self._router.caught_up(now_ns, match)

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
        for number, match in enumerate(tuple(publisher.matches.values()), 1):
            if number % LOOKS_PER_UNIT == 0:
                now_ns = yield 1
            if not match.is_shared:
                continue
            if publisher.ring is None:
                self._reroute(now_ns, match, "its new ring was lost", out)
                now_ns = yield MATCH
            else:
                subscription = match.subscription
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

    def _reroute(self, now_ns: int, match: Match, why: str, out: list[Effect]) -> None:
        if not match.is_shared:
            return
        publisher, subscription = match.publisher, match.subscription
        reroute(now_ns, self._graph, match, out)
        self._overload.bound(now_ns, subscription)
        ends = f"{publisher.node.full_name} to {subscription.node.full_name}"
        out.append(
            Note(logging.WARNING, f"samples on '{publisher.topic.name}' from {ends} go by socket: {why}")
        )
