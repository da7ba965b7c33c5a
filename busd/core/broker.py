"""The broker: one state machine for all peers.

    effects = broker.handle(now_ns, peer, message)     control messages (and the descriptors they bring)
    effects = broker.route(now_ns, peer, run)          samples (then `trim`, if the broker `is_overfull`)
    effects = broker.tick(now_ns)                      when `next_deadline_ns()` has come (the hot
                                                       path reads it as `broker.timers.earliest_ns`)

A peer's mistake becomes a Refused (the request is not carried out) or a Fault and a Disconnect (the peer
broke the protocol); it is never an exception. An exception out of the broker is a bug of busd.
"""

import logging
from collections.abc import Callable
from itertools import count
from typing import Any

from bus.errors import ConfigurationError, QuotaExceeded, RemoteProtocolError
from bus.ids import EndpointId, PeerId
from bus.wire import messages as m
from bus.wire.runs import Account, Run
from busd.core.declaring import Registrar
from busd.core.effects import Disconnect, Effect, Note, Send, Stop
from busd.core.entities import Peer, Publisher
from busd.core.graph import Graph
from busd.core.limits import Limits, TopicRule
from busd.core.liveliness import Leases
from busd.core.matching import give_credit
from busd.core.routes import Routes
from busd.core.routing import Router
from busd.core.timers import NEVER_NS, Timers

_LONGEST_PROGRAM = 64
"""Characters of a program's name that are kept, for the log."""


class Broker:
    """`uid` is the daemon's user, who may stop it; `pid` is told to those who ask for the graph."""

    def __init__(
        self, limits: Limits | None = None, rules: tuple[TopicRule, ...] = (), *, uid: int = 0, pid: int = 0
    ) -> None:
        self.limits = limits or Limits()
        self.graph = Graph()
        self.is_overfull = False
        self._uid = uid
        self._pid = pid
        self._peers: dict[PeerId, Peer] = {}
        self._peer_ids = count(1)
        self.timers = Timers()
        self._out: list[Effect] = []
        emit = self._emit
        self._router = Router(
            self.timers,
            emit,
            window_bytes=self.limits.keep_all_window_bytes,
            window_samples=self.limits.keep_all_window_messages,
        )
        self._leases = Leases(
            self.timers,
            emit,
            lease_ns=int(self.limits.lease_s * 1e9),
            is_attached=lambda peer: peer.id in self._peers,
            evict=self._cut,
        )
        self._registrar = Registrar(self.graph, self.limits, rules, self._leases, self._router)
        routes = Routes(self.graph, self._registrar, self._router)
        self._handlers: dict[type[m.Message], Callable[..., None]] = {
            m.Ping: self._on_ping,
            m.Pong: self._on_nothing,
            m.Share: routes.share,
            m.DeclareType: self._registrar.declare_type,
            m.CreateNode: self._registrar.create_node,
            m.DestroyNode: self._registrar.destroy_node,
            m.CreatePublisher: self._registrar.create_publisher,
            m.CreateSubscription: self._registrar.create_subscription,
            m.DestroyEndpoint: self._registrar.destroy_endpoint,
            m.AssertLiveliness: self._on_assert,
            m.Ack: self._on_ack,
            m.Attach: routes.attach,
            m.RefuseRoute: routes.refuse,
            m.CaughtUp: routes.caught_up,
            m.ReplaceRing: routes.replace_ring,
            m.Report: self._on_report,
            m.GetGraph: self._on_get_graph,
            m.GetType: self._on_get_type,
            m.Observe: self._on_observe,
            m.StopBroker: self._on_stop,
        }

    def attach(self, now_ns: int, hello: m.Hello, *, pid: int, uid: int) -> PeerId:
        """A connection said Hello; `pid` and `uid` are the kernel's word."""
        peer = Peer(
            id=PeerId(next(self._peer_ids)),
            pid=pid,
            uid=uid,
            program=hello.program[:_LONGEST_PROGRAM],
            last_heard_ns=now_ns,
            queued=Account(self.limits.queued_bytes_per_peer),
            history=Account(self.limits.history_bytes_per_peer),
        )
        self._peers[peer.id] = peer
        self._leases.watch_peer(now_ns, peer)
        return peer.id

    def detach(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """The connection is gone: so is all that the peer had."""
        peer = self._peers.get(peer_id)
        if peer is not None:
            self._forget(now_ns, peer)
        return self._take_effects()

    def handle(
        self, now_ns: int, peer_id: PeerId, message: Any, descriptors: tuple[Any, ...] = ()
    ) -> list[Effect]:
        """Carry out one control message.

        `descriptors` are those that it says it brings, in number and kind, or none where they were lost.
        """
        peer = self._peers.get(peer_id)
        if peer is None:
            return []
        self._leases.hear_peer(now_ns, peer)
        handler = self._handlers[type(message)]
        try:
            handler(now_ns, peer, message, self._out, *descriptors)
        except QuotaExceeded as error:
            self._refuse(
                peer, message, str(error), resource=error.resource, used=error.used, limit=error.limit
            )
        except ConfigurationError as error:
            self._refuse(peer, message, str(error))
        except RemoteProtocolError as error:
            self._cut(now_ns, peer, str(error))
        return self._take_effects()

    def route(self, now_ns: int, peer_id: PeerId, run: Run) -> list[Effect]:
        """Queue a run for the subscriptions that match; see `bus.wire.runs` and `busd.core.routing`."""
        peer = self._peers.get(peer_id)
        if peer is None:
            return []
        peer.last_heard_ns = now_ns
        if peer.silent:
            self._leases.hear_peer(now_ns, peer)
        out: list[Effect] = []
        publisher = peer.endpoints.get(EndpointId(run.endpoint))
        try:
            if not isinstance(publisher, Publisher):
                raise RemoteProtocolError(
                    f"a sample from publisher {run.endpoint}, which is not one of yours"
                )
            if publisher.lease_ns:
                self._leases.assert_publisher(now_ns, publisher)
            self.is_overfull = self._router.route(now_ns, publisher, run, out)
        except RemoteProtocolError as error:
            self._cut(now_ns, peer, str(error))
        return [*out, *self._take_effects()] if self._out else out

    def trim(self, now_ns: int) -> list[Effect]:
        """Bound the queues that the last run overfilled; call it after the Flush effects were carried out."""
        self.is_overfull = False
        self._router.trim(now_ns)
        return self._take_effects()

    def expire(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """Drop samples that outlived their lifespan while they waited for this peer."""
        peer = self._peers.get(peer_id)
        for subscription in peer.perishable if peer else ():
            self._router.expire(now_ns, subscription)
        return self._take_effects()

    def next_deadline_ns(self) -> int | None:
        """When `tick` must be called next; None: not before something else happens."""
        due_ns = self.timers.earliest_ns
        return None if due_ns == NEVER_NS else due_ns

    def tick(self, now_ns: int) -> list[Effect]:
        """Carry out what is due."""
        for action in self.timers.due(now_ns):
            action(now_ns)
        return self._take_effects()

    def _emit(self, effect: Effect) -> None:
        self._out.append(effect)

    def _take_effects(self) -> list[Effect]:
        change = self.graph.take_change()
        if change is not None:
            self._out += [Send(peer.id, change) for peer in self._peers.values() if peer.is_observer]
        out, self._out = self._out, []
        # The handlers hold no reference to the list: each is handed the current one.
        return out

    def _refuse(self, peer: Peer, message: Any, text: str, **quota: Any) -> None:
        request = getattr(message, "request", None)
        if request is None:
            self._emit(Note(logging.WARNING, f"{peer.describe()}: {text}"))
        else:
            self._emit(Send(peer.id, m.Refused(request=request, text=text, **quota)))

    def _cut(self, now_ns: int, peer: Peer, reason: str) -> None:
        self._emit(Send(peer.id, m.Fault(text=reason)))
        self._emit(Disconnect(peer.id, reason))
        self._emit(Note(logging.WARNING, f"cut off {peer.describe()}: {reason}"))
        self._forget(now_ns, peer)

    def _forget(self, now_ns: int, peer: Peer) -> None:
        del self._peers[peer.id]
        for node in tuple(peer.nodes.values()):
            self._registrar.remove_node(now_ns, node, self._out, is_lost=True)
        self.graph.forget_types(peer, list(self._peers.values()))
        peer.doorbell = peer.readers = None  # a timer may still know the peer

    def _on_ping(self, now_ns: int, peer: Peer, message: m.Ping, out: list[Effect]) -> None:
        if message.number:
            out.append(Send(peer.id, m.Pong(number=message.number)))

    def _on_nothing(self, now_ns: int, peer: Peer, message: m.Message, out: list[Effect]) -> None:
        """A sign of life, which `handle` has seen already."""

    def _on_assert(self, now_ns: int, peer: Peer, message: m.AssertLiveliness, out: list[Effect]) -> None:
        self._leases.assert_publisher(now_ns, self._registrar.own_publisher(peer, message.publisher))

    def _on_ack(self, now_ns: int, peer: Peer, message: m.Ack, out: list[Effect]) -> None:
        subscription = self._registrar.own_subscription(peer, message.subscription)
        publisher = subscription.matches.get(EndpointId(message.source))
        # A publisher that has just gone may still be acknowledged.
        if publisher is not None and subscription.id in publisher.acked:
            if message.seq >= publisher.next_seq and not publisher.has_shared:
                raise RemoteProtocolError(
                    f"sample {message.seq} of publisher {publisher.id} acknowledged, "
                    f"the last one is {publisher.next_seq - 1}"
                )
            # A replayed sample is below what counts as taken, and so may be one before a drop.
            if message.seq > publisher.acked[subscription.id]:
                publisher.acked[subscription.id] = message.seq
                give_credit(publisher, out.append)

    def _on_report(self, now_ns: int, peer: Peer, message: m.Report, out: list[Effect]) -> None:
        self._registrar.own_endpoint(peer, message.endpoint).report = message

    def _on_get_graph(self, now_ns: int, peer: Peer, message: m.GetGraph, out: list[Effect]) -> None:
        out.append(
            Send(peer.id, self.graph.snapshot(message.request, statistics=message.statistics, pid=self._pid))
        )

    def _on_get_type(self, now_ns: int, peer: Peer, message: m.GetType, out: list[Effect]) -> None:
        schema = self.graph.types.get((message.type_name, message.type_hash))
        if schema is None:
            raise ConfigurationError(f"no endpoint has the type {message.type_name} ({message.type_hash})")
        out.append(Send(peer.id, m.TypeDescription(request=message.request, schema=schema)))

    def _on_observe(self, now_ns: int, peer: Peer, message: m.Observe, out: list[Effect]) -> None:
        peer.is_observer = message.on
        if message.on:
            out.append(Send(peer.id, self.graph.snapshot(message.request, statistics=False, pid=self._pid)))
        else:
            out.append(Send(peer.id, m.Done(request=message.request)))

    def _on_stop(self, now_ns: int, peer: Peer, message: m.StopBroker, out: list[Effect]) -> None:
        if peer.uid not in (0, self._uid):
            raise ConfigurationError(f"user {peer.uid} may not stop the busd of user {self._uid}")
        out.append(Send(peer.id, m.Done(request=message.request)))
        out.append(Stop(f"asked by {peer.describe()}"))
