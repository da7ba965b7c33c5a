"""The broker: one state machine for all peers.

    peer = broker.entrance.attach(now_ns, hello, ...)  who may come, and when: `busd.core.entrance`
    effects = broker.handle(now_ns, peer, message)     control messages (and the descriptors they bring)
    effects = broker.route(now_ns, peer, run)          samples (then `trim`, if the broker `is_overfull`)
    publisher = broker.passage(now_ns, peer, endpoint) may the shell pass on a run by itself? (`passed_on`)
    effects = broker.go_on(now_ns, peer)               while a peer is in `broker.tasks.unfinished`
    effects = broker.tick(now_ns)                      when `next_deadline_ns()` has come (the hot
                                                       path reads it as `broker.timers.earliest_ns`)

Each call takes its work off `broker.meter`. If the meter is used up, the call stops within a step or two.
`go_on` continues the requests of a peer, and the removal of its remains, before any other message of that
peer is handled. Timers that are due stay due. With an unlimited meter all is done at once.

A peer's mistake becomes a Refused (the request is not carried out) or a Fault and a Disconnect (the peer
broke the protocol); it is never an exception. An exception out of the broker is a bug of busd.
"""

import logging
from collections.abc import Callable
from typing import Any

from bus.base.ids import EndpointId, PeerId
from bus.errors import AccessDenied, BusError, ConfigurationError, QuotaExceeded, RemoteProtocolError
from bus.wire import messages as m
from bus.wire.answers import RefusedForNow
from bus.wire.runs import Run
from busd.core.absent import Absentees
from busd.core.access import Access
from busd.core.access_guard import AccessGuard
from busd.core.drops import Drops
from busd.core.effects import Disconnect, Effect, Note, Send
from busd.core.entities import Peer, Publisher
from busd.core.entrance import Entrance
from busd.core.graph import Graph
from busd.core.leases import Leases
from busd.core.limits import Limits, TopicRule
from busd.core.matching import release
from busd.core.operator import Operator
from busd.core.overload import Overload
from busd.core.places import Places
from busd.core.queries import Queries
from busd.core.quotas import Quotas
from busd.core.registry import Registry
from busd.core.router import Router
from busd.core.routing_times import RoutingTimes
from busd.core.settings import AccessReview, Settings
from busd.core.shm_routes import Routes
from busd.core.silence import Silences
from busd.core.tasks import Task, Tasks
from busd.core.timers import NEVER_NS, Timers
from busd.core.work import FRAME, LOOKS_PER_UNIT, Meter, Work


class Broker:
    """`uid` is the daemon's user, which may stop it; `pid` goes with each answer about the graph; `clock_ns`
    is as in Hello.

    `lives` says whether a pid still has a process.
    """

    def __init__(
        self,
        limits: Limits | None = None,
        rules: tuple[TopicRule, ...] = (),
        access: Access | None = None,
        *,
        uid: int = 0,
        pid: int = 0,
        clock_ns: int = 0,
        lives: Callable[[int], bool] = lambda pid: True,
    ) -> None:
        limits = limits or Limits()
        self.graph = Graph()
        self.routing_times = RoutingTimes()
        self.meter = Meter()
        self.is_overfull = False
        self._peers: dict[PeerId, Peer] = {}
        self.timers = Timers()
        self._out: list[Effect] = []
        tasks = self.tasks = Tasks(self._peers, self.meter, self._out)
        emit = self._out.append
        quotas = self._quotas = Quotas(limits)
        drops = Drops(self.timers, emit)
        overload = Overload(quotas, drops, emit, tasks.begin)
        self._router = Router(
            emit,
            drops,
            overload,
            self.meter,
            tasks.begin,
            window_bytes=limits.keep_all_window_bytes,
            window_samples=limits.keep_all_window_messages,
        )
        silences = Silences(self.timers, emit, self.meter, peers=self._peers, lives=lives, evict=self._cut)
        self.passed_on = self._router.passed_on
        lease_ns = int(limits.lease_s * 1e9)
        self._leases = Leases(self.timers, emit, self.meter, lease_ns=lease_ns, silences=silences)
        access_guard = AccessGuard(self.graph, access or Access(uid), tasks.begin)
        self.entrance = Entrance(self._peers, quotas, access_guard, self._leases, silences, clock_ns=clock_ns)
        operator = Operator(access_guard, uid)
        self._absentees = Absentees(self.timers, emit, self.meter)
        self._registry = Registry(
            self.graph,
            quotas,
            rules,
            self._leases,
            self._router,
            overload,
            access_guard,
            self._absentees,
            Places(self.timers, emit, self.meter, drops, lives),
        )
        routes = Routes(self.graph, quotas, self._registry, self._router, overload)
        queries = self._queries = Queries(
            self.graph, quotas, access_guard, self.routing_times, self.meter, self._absentees, pid=pid
        )
        self._handlers: dict[type[m.Message], Callable[..., Work | None]] = {
            m.Ping: self._on_ping,
            m.Pong: self._on_nothing,
            m.Share: routes.share,
            m.DeclareType: self._registry.declare_type,
            m.CreateNode: self._registry.create_node,
            m.DestroyNode: self._registry.destroy_node,
            m.CreatePublisher: self._registry.create_publisher,
            m.CreateSubscription: self._registry.create_subscription,
            m.DestroyEndpoint: self._registry.destroy_endpoint,
            m.AssertLiveliness: self._on_assert,
            m.Ack: self._on_ack,
            m.Attach: routes.attach,
            m.RefuseRoute: routes.refuse,
            m.LeaveRing: routes.leave,
            m.CaughtUp: routes.caught_up,
            m.ReplaceRing: routes.replace_ring,
            m.Report: self._on_report,
            m.GetGraph: queries.get_graph,
            m.GetType: queries.get_type,
            m.GetPeers: queries.get_peers,
            m.Observe: queries.observe,
            m.StopBroker: operator.stop,
            m.Reload: operator.reload,
        }
        review = AccessReview(access_guard, queries, self._out, tasks, self._cut)
        self.settings = Settings(limits, quotas, self._leases, self._router, overload, self._registry, review)

    def reconfigure(
        self, now_ns: int, limits: Limits, rules: tuple[TopicRule, ...], access: Access
    ) -> list[Effect]:
        """Apply these from now on.

        Things over a limit stay, except samples and history that are too many bytes. Topic rules and limits
        of single messages hold for endpoints made from now on, a lease for processes that come from now on.
        """
        self.settings.change(now_ns, limits, rules, access, self._peers.values())
        return self._take_effects()

    def detach(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """The connection is gone: remove everything of the peer."""
        peer = self._peers.get(peer_id)
        if peer is not None:
            self._forget(now_ns, peer)
        return self._take_effects()

    def handle(
        self, now_ns: int, peer_id: PeerId, message: Any, descriptors: tuple[Any, ...] = ()
    ) -> list[Effect]:
        """Carry out one control message.

        `descriptors` match the message in number and kind, or are empty if they were lost.
        """
        peer = self._peers.get(peer_id)
        if peer is None:
            return []
        self._leases.note_alive(now_ns, peer)
        self.meter.left -= FRAME
        try:
            self._quotas.spend(now_ns, peer, message, self.graph, self._out)
            work = self._handlers[type(message)](now_ns, peer, message, self._out, *descriptors)
            if work is not None:
                self.tasks.do(now_ns, Task(peer, work, message))
        except BusError as error:
            self._turn_down(now_ns, peer, message, error)
        return self._take_effects()

    def go_on(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """Continue work that was begun for a peer, present or gone."""
        if (task := self.tasks.unfinished.pop(peer_id, None)) is not None:
            if peer_id in self._peers:
                self._leases.note_alive(now_ns, task.peer)  # busd is late, not the peer
            try:
                self.tasks.do(now_ns, task)
            except BusError as error:
                self._turn_down(now_ns, task.peer, task.message, error)
        if peer_id in self.tasks.feeds:
            self.tasks.feed(now_ns, peer_id)
        self.is_overfull = self._router.is_overfull
        return self._take_effects()

    def route(self, now_ns: int, peer_id: PeerId, run: Run) -> list[Effect]:
        """Queue a run for the subscriptions that match; see `bus.wire.runs` and `busd.core.router`."""
        peer = self._peers.get(peer_id)
        if peer is None:
            return []
        if peer.is_silent or peer.lapsed:
            self._leases.note_alive(now_ns, peer)
        peer.last_heard_ns = now_ns
        out: list[Effect] = []
        publisher = peer.endpoints.get(EndpointId(run.endpoint))
        try:
            if not isinstance(publisher, Publisher):
                raise RemoteProtocolError(
                    f"a sample from publisher {run.endpoint}, which is not one of yours"
                )
            if publisher.lease_ns:
                self._leases.assert_publisher(now_ns, publisher)
            self._router.route(now_ns, publisher, run, out)
            self.is_overfull = self._router.is_overfull
        except RemoteProtocolError as error:
            self._cut(now_ns, peer, str(error))
        if self._out or self.tasks.withheld:
            self._out[:0] = out
            return self._take_effects()
        return out

    def passage(self, now_ns: int, peer_id: PeerId, endpoint: int) -> Publisher | None:
        """A publisher of the peer, if its next run only needs to be sent to its `routed` subscriptions.

        A subscription with queued samples can't get it before these. None: the run must be given to `route`.
        """
        peer = self._peers.get(peer_id)
        if peer is None or peer.is_silent or peer.lapsed or self.tasks.withheld or self.is_overfull:
            return None
        peer.last_heard_ns = now_ns
        publisher = peer.endpoints.get(EndpointId(endpoint))
        if publisher.__class__ is not Publisher or not publisher.routed or publisher.does_more:
            return None
        return publisher

    def trim(self, now_ns: int) -> list[Effect]:
        """Bound the queues that the last run overfilled; call it after the Flush effects were carried out."""
        self.is_overfull = False
        self._router.trim(now_ns)
        return self._take_effects()

    def expire(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """Drop samples that outlived their lifespan while they waited for this peer.

        Stops with the meter. The rest is sent: the peer's process drops and counts it.
        """
        peer = self._peers.get(peer_id)
        if peer is None:
            return []
        self._router.expire(now_ns, peer)
        return self._take_effects()

    def note_alive(self, now_ns: int, peer_id: PeerId) -> list[Effect]:
        """The peer lives: it reads its messages, although the shell does not read from it now."""
        if peer := self._peers.get(peer_id):
            self._leases.note_alive(now_ns, peer)
        return self._take_effects()

    def farewell(self, now_ns: int) -> list[Effect]:
        """The daemon ends: report to each subscription the drops that are not reported yet."""
        self._absentees.farewell(now_ns)
        self.tasks.feed_all(now_ns)
        self._router.trim(now_ns)
        self._router.report_drops(self._peers.values())
        return self._take_effects()

    def next_deadline_ns(self) -> int | None:
        """When `tick` must be called next; None: not before something else happens."""
        due_ns = self.timers.earliest_ns
        return None if due_ns == NEVER_NS else due_ns

    def tick(self, now_ns: int) -> list[Effect]:
        """Carry out due actions, as far as the meter allows."""
        for action in self.timers.due(now_ns):
            action(now_ns)
            self.meter.left -= FRAME
            if self.meter.left <= 0:
                break
        return self._take_effects()

    def _take_effects(self) -> list[Effect]:
        change = self.graph.changes.take()
        if change is not None:
            self.meter.left -= self._queries.notify(change, self._out)
        if self.tasks.withheld:
            self.tasks.withhold()
        out = self._out.copy()  # unfinished work still adds to the list
        self._out.clear()
        return out

    def _turn_down(self, now_ns: int, peer: Peer, message: Any, error: BusError) -> None:
        """The message failed with `error`; a peer that broke the protocol is cut off."""
        match error:
            case QuotaExceeded():
                self._quotas.refused(now_ns, peer, error, self._out)
                quota = {"resource": error.resource, "used": error.used, "limit": error.limit}
                self._refuse(peer, message, str(error), **quota)
            case AccessDenied():
                self._refuse(peer, message, str(error), denied=True)
            case RefusedForNow():
                self._refuse(peer, message, str(error), again=True)
            case ConfigurationError():
                self._refuse(peer, message, str(error))
            case RemoteProtocolError():
                self._cut(now_ns, peer, str(error))
            case _:
                raise error

    def _refuse(self, peer: Peer, message: Any, text: str, **reason: Any) -> None:
        """Answer that the request was not carried out. For a message without an answer (DeclareType) the log
        has said so.
        """
        request = getattr(message, "request", None)
        if request is not None:
            self._out.append(Send(peer.id, m.Refused(request=request, text=text, **reason)))

    def _cut(self, now_ns: int, peer: Peer, reason: str) -> None:
        self._out.append(Send(peer.id, m.Fault(text=reason)))
        self._out.append(Disconnect(peer.id, reason))
        self._out.append(Note(logging.WARNING, f"cut off {peer.describe()}: {reason}"))
        self._forget(now_ns, peer)

    def _forget(self, now_ns: int, peer: Peer) -> None:
        del self._peers[peer.id]
        peer.has_gone = True
        self.tasks.drop(peer)
        self._queries.forget(peer)
        self.tasks.do(now_ns, Task(peer, self._depart(peer)))

    def _depart(self, peer: Peer) -> Work:
        """Take everything of `peer` out of the graph. Its requests are dropped."""
        for node in tuple(peer.nodes.values()):
            yield from self._registry.remove_node(node, self._out, is_lost=True)
        yield from self.graph.types.forget(peer)
        self._quotas.leave(peer)
        peer.doorbell = peer.readers = None  # a timer may still know the peer

    def _on_ping(self, now_ns: int, peer: Peer, message: m.Ping, out: list[Effect]) -> None:
        if message.number:
            out.append(Send(peer.id, m.Pong(number=message.number)))

    def _on_nothing(self, now_ns: int, peer: Peer, message: m.Message, out: list[Effect]) -> None:
        """A sign of life, which `handle` has seen already."""

    def _on_assert(self, now_ns: int, peer: Peer, message: m.AssertLiveliness, out: list[Effect]) -> None:
        self._leases.assert_publisher(now_ns, self._registry.own_publisher(peer, message.publisher))

    def _on_ack(self, now_ns: int, peer: Peer, message: m.Ack, out: list[Effect]) -> None:
        subscription = self._registry.own_subscription(peer, message.subscription)
        match = subscription.matches.get(EndpointId(message.source))
        if match is None:  # a publisher that has just gone may still be acknowledged
            return
        publisher = match.publisher
        self.meter.left -= len(publisher.awaited) // LOOKS_PER_UNIT
        if match.acked_seq is not None:
            newest_seq = max(publisher.next_seq - 1, match.acked_seq)
            if message.seq > newest_seq and not publisher.has_shared:
                raise RemoteProtocolError(
                    f"sample {message.seq} of publisher {publisher.id} acknowledged, "
                    f"the last one is {publisher.next_seq - 1}"
                )
            # A replayed sample has a lower number than the acknowledged ones, and so may a sample before a
            # drop.
            release(match, message.seq, out.append)

    def _on_report(self, now_ns: int, peer: Peer, message: m.Report, out: list[Effect]) -> None:
        self._registry.own_endpoint(peer, message.endpoint).report = message
