"""Rows about publishers, subscriptions, rates and losses, made from graphs and their counters.

Pure: graphs and times come in, rows go out. `bus top` and the page both show them.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

from bus.diagnostics.mismatch import Describe, mismatch
from bus.graph import Graph, GraphEndpoint, GraphMatch
from bus.names import is_hidden_node, is_hidden_topic
from bus_plot.loss_timeline import LossTimeline
from bus_web.advice import advice
from bus_web.counters import Counters, Group, age_parts_of, ages_of, depth_of, lost_history_of
from bus_web.rates import RateHistory
from bus_web.rows import EndpointRow, NodeRow, Pair, Sums, TopicRow

__all__ = ["Model"]

_MOST_PAIRS = 1000
"""The model checks at most so many pairs of a topic: a list of a thousand publishers, each with a thousand
subscriptions, is not readable."""

_MOST_PASTS = 1000
"""The model remembers so many subscriptions that have left after losses, and so many topics with losses but
without an endpoint. Above that, it forgets the first that has left."""


def _forget_first(kept: dict[Any, Any]) -> None:
    while len(kept) > _MOST_PASTS:
        del kept[next(iter(kept))]


def _identity(graph: Graph) -> tuple[int, int]:
    return graph.revision, graph.broker_pid


class Model:
    """The bus as it was at the last look, and how fast things went until then.

    `own`: processes of the viewing tools; the model leaves out their hidden nodes. The model calls `describe`
    if two types have one name.
    """

    def __init__(self, own: Iterable[int] = (), describe: Describe = lambda name, number: None) -> None:
        self._own = frozenset(own)
        self._describe = describe
        self._graph: Graph | None = None
        self._gids: list[bytes] = []
        self._counters: list[Counters | None] = []
        """One for each endpoint of the graph; None for hidden endpoints of `own`."""
        self._topics: dict[str, Group] = {}
        self._nodes: dict[int, Group] = {}
        """Keys are node ids in the graph."""
        self._matches: dict[int, list[GraphMatch]] = {}
        """Keys are the ids of both endpoints."""
        self._pairs: dict[str, tuple[Pair, ...]] = {}
        self._looked_ns = 0
        self._left: dict[bytes, Counters] = {}
        """Subscriptions with losses that are not in the graph: they come back after a restart of busd."""
        self._pasts: dict[str, LossTimeline] = {}
        """Losses of topics that are not in the graph."""

    @property
    def has_graph(self) -> bool:
        """Whether the model has taken a graph yet."""
        return self._graph is not None

    @property
    def graph(self) -> Graph:
        """The newest graph. Call this only after the first look."""
        assert self._graph is not None, "no graph yet"
        return self._graph

    def take(self, graph: Graph, now_ns: int) -> bool:
        """A look: the graph with its statistics, and the time of the monotonic clock.

        Returns whether nodes, endpoints or matches differ from the look before.
        """
        before, self._graph = self._graph, graph
        ends = (*graph.publishers, *graph.subscriptions)
        gids = [one.gid for one in ends]
        is_new = before is None or _identity(before) != _identity(graph) or gids != self._gids
        if is_new:
            self._arrange(ends, gids)
        for one, mine in zip(ends, self._counters, strict=True):
            if mine is not None:
                mine.take(one, now_ns, self._looked_ns)
        for group in self._topics.values():
            group.add(now_ns)
        for group in self._nodes.values():
            group.add(now_ns)
        self._looked_ns = now_ns
        return is_new

    def _arrange(self, ends: Sequence[GraphEndpoint], gids: list[bytes]) -> None:
        """Group the endpoints again, and keep the earlier state of each endpoint and each group."""
        counters = dict(zip(self._gids, self._counters, strict=True))
        topics: dict[str, Group] = {}
        nodes: dict[int, Group] = {}
        self._gids, self._counters = gids, []
        for one in ends:
            if one.node.pid in self._own and is_hidden_node(one.node.name):
                self._counters.append(None)
                continue
            mine = counters.pop(one.gid, None) or self._left.pop(one.gid, None) or Counters()
            self._counters.append(mine)
            if (topic := topics.get(one.topic)) is None:
                topic = topics[one.topic] = Group(
                    known.history if (known := self._topics.get(one.topic)) else RateHistory(),
                    self._timeline_of(one.topic),
                    is_hidden=is_hidden_topic(one.topic),
                )
            if (node := nodes.get(one.node.id)) is None:
                node = nodes[one.node.id] = Group(
                    known.history if (known := self._nodes.get(one.node.id)) else RateHistory(),
                    is_hidden=is_hidden_node(one.node.name),
                )
            for group in (topic, node):
                (group.publishers if one.kind == "publisher" else group.subscriptions).append(mine)
        self._remember(counters.items(), topics)
        self._topics, self._nodes = {name: topics[name] for name in sorted(topics)}, nodes
        self._pairs = {}
        self._matches = {}
        for match in self.graph.matches:
            self._matches.setdefault(match.publisher, []).append(match)
            self._matches.setdefault(match.subscription, []).append(match)

    def _timeline_of(self, topic: str) -> LossTimeline:
        known = self._topics.get(topic)
        timeline = known.timeline if known is not None else self._pasts.pop(topic, None)
        return timeline or LossTimeline()

    def _remember(self, left: Iterable[tuple[bytes, Counters | None]], topics: Collection[str]) -> None:
        """Keep the losses of endpoints that are no longer in the graph, and of their topics."""
        self._left.update((gid, one) for gid, one in left if one is not None and one.timeline)
        for name, group in self._topics.items():
            if group.timeline and name not in topics:
                self._pasts[name] = group.timeline
        _forget_first(self._left)
        _forget_first(self._pasts)

    def losses(self, topic: str) -> LossTimeline | None:
        """When messages of a topic were lost, in seconds of the monotonic clock, from the first look on; None
        if the topic does not exist."""
        group = self._topics.get(topic)
        return None if group is None else group.timeline

    def age_parts(self, topic: str) -> list[int]:
        """The histogram of the ages of a topic's messages, of the last ten seconds; empty if the topic does
        not exist."""
        group = self._topics.get(topic)
        return [] if group is None else age_parts_of(group.subscriptions)

    def forget_pairs(self) -> None:
        """Call this when `describe` has learned more since the model called it."""
        self._pairs = {}
        for group in (*self._topics.values(), *self._nodes.values()):
            group.fixed = None

    def topics(self, *, hidden: bool = False) -> list[TopicRow]:
        """A row for each topic, sorted by name; `hidden` ones too."""
        return [
            self._topic(name, group) for name, group in self._topics.items() if hidden or not group.is_hidden
        ]

    def topic(self, name: str) -> TopicRow | None:
        """The row of one topic, by its full name; None if the topic does not exist."""
        group = self._topics.get(name)
        return None if group is None else self._topic(name, group)

    def nodes(self, *, hidden: bool = False) -> list[NodeRow]:
        """A row for each node that has endpoints, sorted by name; `hidden` ones too."""
        nodes = sorted(self.graph.nodes, key=lambda one: (one.full_name, one.id))
        return [
            NodeRow(node=one.full_name, id=one.id, pid=one.pid, **self._fixed(group), **group.counted())
            for one in nodes
            if (group := self._nodes.get(one.id)) is not None and (hidden or not group.is_hidden)
        ]

    def endpoints_of_node(self, number: int) -> list[EndpointRow]:
        """The publishers of a node, by its id in the graph, then its subscriptions; sorted by topic."""
        if (group := self._nodes.get(number)) is None:
            return []
        return [
            self._endpoint(one)
            for ends in (group.publishers, group.subscriptions)
            for one in sorted(ends, key=lambda one: one.endpoint.topic)
        ]

    def endpoints(self, topic: str) -> list[EndpointRow]:
        """The publishers of a topic, then its subscriptions; empty if the topic does not exist."""
        if (group := self._topics.get(topic)) is None:
            return []
        return [self._endpoint(one) for one in (*group.publishers, *group.subscriptions)]

    def all_endpoints(self) -> list[EndpointRow]:
        """The endpoints of all topics, including hidden topics."""
        return [row for topic in self._topics for row in self.endpoints(topic)]

    def pairs(self, topic: str) -> tuple[Pair, ...]:
        """Pairs of a publisher and a subscription of a topic that match, or have a known reason for no match.

        For a topic with more than a thousand pairs: all matches, but only the first of the other pairs.
        """
        known = self._pairs.get(topic)
        if known is None:
            known = self._pairs[topic] = tuple(self._find_pairs(topic))
        return known

    def sums(self, rows: Iterable[TopicRow]) -> Sums:
        """Sums of these rows, and the number of nodes that are not hidden."""
        shown = [*rows]
        return Sums(
            nodes=sum(not is_hidden_node(one.name) for one in self.graph.nodes),
            topics=len(shown),
            hz=sum(row.hz or 0.0 for row in shown),
            bytes_per_s=sum(row.bytes_per_s or 0.0 for row in shown),
            lost_per_s=sum(row.lost_per_s for row in shown),
            lost=sum(row.lost for row in shown),
        )

    def _topic(self, name: str, group: Group) -> TopicRow:
        return TopicRow(topic=name, **self._fixed(group, name), **group.counted())

    def _fixed(self, group: Group, topic: str = "") -> dict[str, Any]:
        """The fields of a row of a `topic`, or of a node, that change with the graph only."""
        if (known := group.fixed) is not None:
            return known
        found: dict[str, Any] = {
            "publishers": len(group.publishers),
            "subscriptions": len(group.subscriptions),
        }
        ends = group.ends
        if topic:
            found["types"] = tuple(sorted({one.type_name for one in ends}))
            found["mismatches"] = sum(not pair.route for pair in self.pairs(topic))
            ends = [one.endpoint for one in group.subscriptions]  # a publisher has matches of others, too
        else:
            found["mismatches"] = self._mismatches_of(ends)
        found["routes"] = tuple(sorted({route for one in ends for route in self._routes(one)}))
        group.fixed = found
        return found

    def _mismatches_of(self, ends: Sequence[GraphEndpoint]) -> int:
        mine = {one.id for one in ends}
        return sum(
            not pair.route and (pair.publisher in mine or pair.subscription in mine)
            for topic in {one.topic for one in ends}
            for pair in self.pairs(topic)
        )

    def _endpoint(self, mine: Counters) -> EndpointRow:
        one, counters = mine.endpoint, mine.statistics
        hz, bytes_per_s = mine.rates or (None, None)
        return EndpointRow(
            id=one.id,
            kind=one.kind,
            topic=one.topic,
            node=one.node.full_name,
            node_id=one.node.id,
            pid=one.node.pid,
            type_name=one.type_name,
            qos=one.qos,
            messages=counters.samples,
            bytes=counters.bytes,
            hz=hz,
            bytes_per_s=bytes_per_s,
            queued=counters.queued,
            depth=depth_of(one.qos),
            dropped=mine.dropped,
            lost_per_s=mine.lost_per_s,
            routes=tuple(sorted(self._routes(one))),
            age=ages_of([mine]),
            lost_history=lost_history_of([mine.timeline], self._looked_ns)
            if one.kind == "subscription"
            else (),
            advice=self._advice(mine),
        )

    def _advice(self, mine: Counters) -> str:
        one = mine.endpoint
        if one.kind == "publisher" or not mine.dropped:
            return ""
        return advice(one.qos, mine.statistics, self._topics[one.topic].hz)

    def _routes(self, one: GraphEndpoint) -> set[str]:
        return {match.route for match in self._matches.get(one.id, ())}

    def _find_pairs(self, topic: str) -> Iterator[Pair]:
        if (group := self._topics.get(topic)) is None or not group.publishers or not group.subscriptions:
            return
        publishers = [one.endpoint for one in group.publishers]
        subscriptions = [one.endpoint for one in group.subscriptions]
        here = {one.id for one in subscriptions}
        routes = {
            (match.publisher, match.subscription): match.route
            for one in publishers
            for match in self._matches.get(one.id, ())
            if match.subscription in here
        }
        for (publisher, subscription), route in routes.items():
            yield Pair(publisher, subscription, route)
        if len(routes) == len(publishers) * len(subscriptions):
            return
        left = _MOST_PAIRS
        for one in publishers:
            for other in subscriptions:
                if (one.id, other.id) in routes:
                    continue
                if not left:
                    return
                left -= 1
                if reason := mismatch(one, other, self._describe):
                    yield Pair(one.id, other.id, reason=reason)
