"""Questions and their answers: the graph, types, resources of each process; and the observers of the graph.

Handlers of the broker's control messages, as in `busd.core.registry`. Owns the observers. Changes nothing
that a peer could see.
"""

from collections.abc import Mapping
from functools import partial

from msgspec import structs

from bus.base.ids import EndpointId, PeerId
from bus.errors import ConfigurationError
from bus.wire import messages as m
from busd.core.absent import Absentees
from busd.core.access_guard import AccessGuard
from busd.core.effects import Effect, Send
from busd.core.entities import GRAPH, Peer, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.graph_view import GraphView
from busd.core.quotas import Quotas
from busd.core.routing_times import RoutingTimes
from busd.core.snapshot import take_snapshot
from busd.core.work import LOOKS_PER_UNIT, RECORD, TELL, Meter, Work

_ASKED_AT_ONCE = 16
"""Endpoints that are checked against new rules of access in one piece of work; fewer if there are many
rules.
"""
_RULES_AT_ONCE = 1024


class Queries:
    """Carries out GetGraph, GetType, GetPeers and Observe.

    `pid` goes with a graph. Only peers that no access rule applies to see what other users hold.
    """

    def __init__(
        self,
        graph: Graph,
        quotas: Quotas,
        access_guard: AccessGuard,
        times: RoutingTimes,
        meter: Meter,
        absentees: Absentees,
        *,
        pid: int,
    ) -> None:
        self._graph = graph
        self._quotas = quotas
        self._access_guard = access_guard
        self._times = times
        self._meter = meter
        self._absentees = absentees
        self._pid = pid
        self._observers: dict[PeerId, GraphView | None] = {}
        """The view of each observer; None: everything."""
        self._filling: dict[PeerId, GraphView] = {}
        """Views that are being filled; then their peers observe."""

    def get_graph(self, now_ns: int, peer: Peer, message: m.GetGraph, out: list[Effect]) -> Work:
        view = self._view(peer)
        if view is not None:
            yield from view.fill()
        answer = yield from take_snapshot(
            self._graph,
            message.request,
            statistics=message.statistics,
            pid=self._pid,
            shown=None if view is None else view.shown,
        )
        out.append(Send(peer.id, answer))

    def get_type(self, now_ns: int, peer: Peer, message: m.GetType, out: list[Effect]) -> Work:
        kind = (message.type_name, message.type_hash)
        schema = self._graph.types.find(kind)
        is_shown, view = schema is not None, self._view(peer)
        if view is not None:
            yield from view.fill()
            is_shown = is_shown and (yield from view.shows_type(kind))
        if schema is None or not is_shown:
            raise ConfigurationError(f"no endpoint has the type {message.type_name} ({message.type_hash})")
        out.append(Send(peer.id, m.TypeDescription(request=message.request, schema=schema)))

    def get_peers(self, now_ns: int, peer: Peer, message: m.GetPeers, out: list[Effect]) -> None:
        sees_all = self._access_guard.access.is_free(peer.uid)
        peers, users = self._quotas.records(now_ns, None if sees_all else peer.user)
        self._meter.left -= RECORD * len(peers) + len(self._graph.publishers) // LOOKS_PER_UNIT
        samples, size = self._graph.routed()
        answer = m.Peers(
            request=message.request,
            peers=peers,
            users=users,
            routing=self._times.record(samples=samples, bytes=size) if sees_all else m.RoutingRecord(),
            limits=structs.asdict(self._quotas.limits),
            absent=self._absentees.record() if sees_all else m.AbsentRecord(),
        )
        out.append(Send(peer.id, answer))

    def observe(self, now_ns: int, peer: Peer, message: m.Observe, out: list[Effect]) -> Work:
        self.forget(peer)
        if not message.on:
            out.append(Send(peer.id, m.Done(request=message.request)))
            return
        view = self._view(peer)
        if view is not None:
            self._filling[peer.id] = view
            yield from view.fill()
            del self._filling[peer.id]
        self._observers[peer.id] = view
        peer.withheld = GRAPH  # later changes must not come before the answer
        answer = yield from take_snapshot(
            self._graph,
            message.request,
            statistics=False,
            pid=self._pid,
            shown=None if view is None else view.shown,
        )
        out.append(Send(peer.id, answer))

    def forget(self, peer: Peer) -> None:
        """Send `peer` no more changes."""
        self._observers.pop(peer.id, None)
        self._filling.pop(peer.id, None)

    def notify(self, change: m.GraphChanged, out: list[Effect]) -> int:
        """Send each observer its view of the change; returns the cost."""
        for partial_view in self._filling.values():
            partial_view.changed(change)
        for peer, view in self._observers.items():
            out.append(Send(peer, change if view is None else view.changed(change)))
        return TELL * (len(self._observers) + len(self._filling))

    def renew(self, peer: Peer, out: list[Effect]) -> Work:
        """Other rules of access apply: if `peer` observes, send it the records that it now sees or no longer
        sees.
        """
        graph, guard = self._graph, self._access_guard
        at_once = max(1, min(_ASKED_AT_ONCE, _RULES_AT_ONCE // (1 + len(guard.access.rules))))
        tables: tuple[Mapping[EndpointId, Publisher | Subscription], ...]
        tables = (graph.publishers, graph.subscriptions)
        for table in tables:
            endpoints: tuple[Publisher | Subscription, ...] = tuple(table.values())
            for at in range(0, len(endpoints), at_once):
                some = endpoints[at : at + at_once]
                view = self._observers.get(peer.id) or self._filling.get(peer.id)
                if view is None:
                    return
                price = 0
                if (pending := graph.changes.take()) is not None:
                    price = self.notify(pending, out)  # else it would tell of the same matches
                looks, few = guard.access.looks, [one for one in some if one.id in table]
                if (change := view.ask_again(few, graph.changes.revision + 1)) is not None:
                    graph.changes.skip_revision()
                    price += RECORD * (len(change.matches_added) + len(change.matches_removed) + len(few))
                    if peer.id in self._observers:
                        out.append(Send(peer.id, change))
                yield price + TELL * len(some) + guard.price(looks)

    def _view(self, peer: Peer) -> GraphView | None:
        """The part of the graph that `peer` may see; None: everything."""
        if self._access_guard.access.is_free(peer.uid):
            return None
        return GraphView(self._graph, peer, partial(self._access_guard.may_observe, peer))
