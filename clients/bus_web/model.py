"""Who publishes what to whom, how fast, and who loses what: rows out of graphs and their counters.

Pure: graphs and times come in, rows go out. `bus top` and the page both show them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from bus.diagnostics.mismatch import Describe, mismatch
from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphMatch
from bus.names import is_hidden_node, is_hidden_topic
from bus.qos import History, QoSProfile
from bus_web.rates import Meter, Seconds

__all__ = ["Ages", "EndpointRow", "Model", "NodeRow", "Pair", "Sums", "TopicRow"]

_NS = 1_000_000_000
_NOW_NS = 3 * _NS
"""What was lost within that time is lost now."""
_MOST_PAIRS = 1000
"""Pairs of a topic that are looked at: each of a thousand publishers with each of a thousand subscriptions is
not for reading."""
_NOTHING = EndpointStatistics()


class Ages(msgspec.Struct, frozen=True):
    """How old messages were when programs took them, of late: seconds since they were published."""

    mean: float
    most: float


class Pair(msgspec.Struct, frozen=True):
    """A publisher and a subscription of one topic: they match by a `route`, or don't for a `reason`."""

    publisher: int
    """Its id in the graph."""
    subscription: int
    route: str = ""
    """`shm`, `socket`, ...; empty where they don't match."""
    reason: str = ""
    """A sentence in busd's words; empty where they match."""


class EndpointRow(msgspec.Struct, frozen=True, kw_only=True):
    """A publisher or a subscription, with what it counts."""

    id: int
    """In the graph."""
    kind: str
    """`publisher` or `subscription`."""
    topic: str
    node: str
    """Its full name."""
    node_id: int
    pid: int
    type_name: str
    qos: QoSProfile
    messages: int
    """Published, or delivered."""
    bytes: int
    hz: float | None
    """Messages a second; None until that is known."""
    bytes_per_s: float | None
    queued: int
    """Messages that wait."""
    depth: int | None
    """How many may wait; None where all are kept."""
    dropped: Mapping[str, int]
    """Messages lost, by reason, all in all."""
    lost_per_s: float
    """Of late."""
    routes: tuple[str, ...]
    """Of its matches, each route once."""
    age: Ages | None
    """Of what a subscription took; None where it took nothing of late."""

    @property
    def lost(self) -> int:
        """All in all."""
        return sum(self.dropped.values())

    @property
    def is_hidden(self) -> bool:
        """Of a tool's node."""
        return is_hidden_node(self.node.rpartition("/")[2])


class _Row(msgspec.Struct, frozen=True, kw_only=True):
    """What some endpoints count together."""

    hz: float | None
    """Messages a second of all publishers; None until that is known of one."""
    bytes_per_s: float | None
    history: tuple[float, ...]
    """Hz in each of the last 60 seconds, the newest last."""
    publishers: int
    subscriptions: int
    routes: tuple[str, ...]
    """Of its matches, each route once."""
    queued: int
    """Messages that wait for subscriptions."""
    depth: int | None
    """Of the subscription for which most wait; None where there is none, or it keeps all."""
    age: Ages | None
    """Of what subscriptions took; None where they took nothing of late."""
    lost_per_s: float
    """Messages that subscriptions lose, of late."""
    dropped: Mapping[str, int]
    """Messages that subscriptions have lost, by reason."""
    mismatches: int
    """Pairs that don't match."""

    @property
    def lost(self) -> int:
        return sum(self.dropped.values())

    @property
    def why(self) -> str:
        """The reason of most losses; empty where nothing was lost."""
        return max(self.dropped, key=self.dropped.__getitem__) if self.lost else ""


class TopicRow(_Row, frozen=True, kw_only=True):
    """A topic, with what its endpoints count together."""

    topic: str
    types: tuple[str, ...]
    """More than one is a conflict."""

    @property
    def is_hidden(self) -> bool:
        return is_hidden_topic(self.topic)


class NodeRow(_Row, frozen=True, kw_only=True):
    """A node, with what its endpoints count together."""

    node: str
    """Its full name."""
    id: int
    """In the graph."""
    pid: int

    @property
    def is_hidden(self) -> bool:
        """Of a tool."""
        return is_hidden_node(self.node.rpartition("/")[2])


class Sums(msgspec.Struct, frozen=True):
    """Of all that is shown."""

    nodes: int
    topics: int
    hz: float
    bytes_per_s: float
    lost_per_s: float
    lost: int


def _depth(qos: QoSProfile) -> int | None:
    return qos.depth if qos.history is History.KEEP_LAST else None


def _identity(graph: Graph) -> tuple[int, int]:
    return graph.revision, graph.broker_pid


class _Counters:
    """Of one endpoint, from look to look: `endpoint` and its `statistics` are of the newest."""

    __slots__ = (
        "aged",
        "endpoint",
        "looked_ns",
        "losses",
        "lost",
        "lost_per_s",
        "meter",
        "rates",
        "statistics",
    )

    def __init__(self) -> None:
        self.endpoint: GraphEndpoint
        self.statistics = _NOTHING
        self.aged: EndpointStatistics | None = None
        """The newest in which ages were told, of late."""
        self.meter = Meter()
        self.rates: tuple[float, ...] | None = None
        self.losses: list[tuple[int, int]] = []  # when, and how many in all: of the last seconds
        self.lost = -1
        self.lost_per_s = 0.0
        self.looked_ns = 0

    def take(self, endpoint: GraphEndpoint, now_ns: int) -> None:
        self.endpoint = endpoint
        self.statistics = statistics = endpoint.statistics or _NOTHING
        self.meter.add(statistics.at_ns, statistics.samples, statistics.bytes)
        self.rates = self.meter.rates(now_ns)
        if statistics.age_count:
            self.aged = statistics
        elif self.aged is not None and now_ns - self.aged.at_ns > _NOW_NS:
            self.aged = None
        lost = sum(statistics.dropped.values()) if statistics.dropped else 0
        if lost != self.lost or len(self.losses) != 1:
            self._lose(lost, now_ns)
        self.looked_ns = now_ns

    def _lose(self, lost: int, now_ns: int) -> None:
        losses, self.lost = self.losses, lost
        if losses and losses[0][1] == lost:
            losses[:] = [(max(losses[0][0], now_ns - _NOW_NS), lost)]
            self.lost_per_s = 0.0
            return
        if losses and lost < losses[-1][1]:
            losses.clear()
        if len(losses) == 1:  # as many until the last look
            losses[0] = max(losses[0][0], self.looked_ns - _NOW_NS), losses[0][1]
        losses.append((now_ns, lost))
        while len(losses) > 2 and losses[1][0] <= now_ns - _NOW_NS:
            del losses[0]
        span_ns = now_ns - losses[0][0]
        self.lost_per_s = (lost - losses[0][1]) * _NS / span_ns if span_ns else 0.0


def _ages(counters: Iterable[_Counters]) -> Ages | None:
    number = sum_ns = most_ns = 0
    for one in counters:
        if (aged := one.aged) is not None:
            number += aged.age_count
            sum_ns += aged.age_sum_ns
            most_ns = max(most_ns, aged.age_max_ns)
    return Ages(sum_ns / number / _NS, most_ns / _NS) if number else None


class _Group:
    """The endpoints of a topic, or of a node, and what they count together."""

    __slots__ = ("bytes_per_s", "fixed", "history", "hz", "is_hidden", "publishers", "subscriptions")

    def __init__(self, history: Seconds, *, is_hidden: bool) -> None:
        self.publishers: list[_Counters] = []
        self.subscriptions: list[_Counters] = []
        self.is_hidden = is_hidden
        self.history = history
        self.hz: float | None = None
        self.bytes_per_s: float | None = None
        self.fixed: dict[str, Any] | None = None
        """Of its row, what is the same as long as the graph is."""

    @property
    def ends(self) -> list[GraphEndpoint]:
        return [one.endpoint for one in (*self.publishers, *self.subscriptions)]

    def add(self, now_ns: int) -> None:
        """Its endpoints have been looked at."""
        hz = bytes_per_s = None
        for one in self.publishers:
            if (rates := one.rates) is not None:
                hz, bytes_per_s = (hz or 0.0) + rates[0], (bytes_per_s or 0.0) + rates[1]
        self.hz, self.bytes_per_s = hz, bytes_per_s
        if hz is not None or self.history:  # what is not known yet is not nothing
            self.history.add(now_ns, hz or 0.0)

    def counted(self) -> dict[str, Any]:
        """The fields that rows have in common and that change with every look."""
        dropped: dict[str, int] = {}
        queued, most, depth, lost_per_s = 0, -1, None, 0.0
        for one in self.subscriptions:
            counters = one.statistics
            for reason, count in counters.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
            queued += counters.queued
            if counters.queued > most:
                most, depth = counters.queued, _depth(one.endpoint.qos)
            lost_per_s += one.lost_per_s
        return {
            "hz": self.hz,
            "bytes_per_s": self.bytes_per_s,
            "history": self.history.values,
            "queued": queued,
            "depth": depth,
            "age": _ages(self.subscriptions),
            "lost_per_s": lost_per_s,
            "dropped": dropped,
        }


class Model:
    """The bus as it was at the last look, and how fast things went until then.

    `own` are the processes of those who look: their hidden nodes are left out. `describe` is asked where two
    types have one name.
    """

    def __init__(self, own: Iterable[int] = (), describe: Describe = lambda name, number: None) -> None:
        self._own = frozenset(own)
        self._describe = describe
        self._graph: Graph | None = None
        self._gids: list[bytes] = []
        self._counters: list[_Counters | None] = []
        """Of each endpoint of the graph; None for those of `own` that are hidden."""
        self._topics: dict[str, _Group] = {}
        self._nodes: dict[int, _Group] = {}
        """By their ids in the graph."""
        self._matches: dict[int, list[GraphMatch]] = {}
        """By the ids of both ends."""
        self._pairs: dict[str, tuple[Pair, ...]] = {}

    @property
    def has_graph(self) -> bool:
        """Whether somebody has looked yet."""
        return self._graph is not None

    @property
    def graph(self) -> Graph:
        """The newest. Not before the first look."""
        assert self._graph is not None, "nobody has looked yet"
        return self._graph

    def take(self, graph: Graph, now_ns: int) -> bool:
        """A look: the graph with its statistics, and the time of the monotonic clock.

        Returns whether nodes, endpoints or matches are others than at the look before.
        """
        before, self._graph = self._graph, graph
        ends = (*graph.publishers, *graph.subscriptions)
        gids = [one.gid for one in ends]
        is_new = before is None or _identity(before) != _identity(graph) or gids != self._gids
        if is_new:
            self._arrange(ends, gids)
        for one, mine in zip(ends, self._counters, strict=True):
            if mine is not None:
                mine.take(one, now_ns)
        for group in self._topics.values():
            group.add(now_ns)
        for group in self._nodes.values():
            group.add(now_ns)
        return is_new

    def _arrange(self, ends: Sequence[GraphEndpoint], gids: list[bytes]) -> None:
        """Which endpoints are together, and what each of them and each group was before."""
        counters = dict(zip(self._gids, self._counters, strict=True))
        topics: dict[str, _Group] = {}
        nodes: dict[int, _Group] = {}
        self._gids, self._counters = gids, []
        for one in ends:
            if one.node.pid in self._own and is_hidden_node(one.node.name):
                self._counters.append(None)
                continue
            mine = counters.get(one.gid) or _Counters()
            self._counters.append(mine)
            if (topic := topics.get(one.topic)) is None:
                topic = topics[one.topic] = _Group(
                    known.history if (known := self._topics.get(one.topic)) else Seconds(),
                    is_hidden=is_hidden_topic(one.topic),
                )
            if (node := nodes.get(one.node.id)) is None:
                node = nodes[one.node.id] = _Group(
                    known.history if (known := self._nodes.get(one.node.id)) else Seconds(),
                    is_hidden=is_hidden_node(one.node.name),
                )
            for group in (topic, node):
                (group.publishers if one.kind == "publisher" else group.subscriptions).append(mine)
        self._topics, self._nodes = {name: topics[name] for name in sorted(topics)}, nodes
        self._pairs = {}
        self._matches = {}
        for match in self.graph.matches:
            self._matches.setdefault(match.publisher, []).append(match)
            self._matches.setdefault(match.subscription, []).append(match)

    def forget_pairs(self) -> None:
        """`describe` knows more than when it was asked."""
        self._pairs = {}
        for group in (*self._topics.values(), *self._nodes.values()):
            group.fixed = None

    def topics(self, *, hidden: bool = False) -> list[TopicRow]:
        """A row for each topic, sorted by name; `hidden` ones too."""
        return [
            self._topic(name, group) for name, group in self._topics.items() if hidden or not group.is_hidden
        ]

    def topic(self, name: str) -> TopicRow | None:
        """The row of one topic, by its full name; None where it is not there."""
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
        """The publishers of a topic, then its subscriptions; none where it is not there."""
        if (group := self._topics.get(topic)) is None:
            return []
        return [self._endpoint(one) for one in (*group.publishers, *group.subscriptions)]

    def all_endpoints(self) -> list[EndpointRow]:
        """Those of all topics, hidden ones too."""
        return [row for topic in self._topics for row in self.endpoints(topic)]

    def pairs(self, topic: str) -> tuple[Pair, ...]:
        """Each publisher of a topic with each subscription, where they match or it is known why not.

        Of a topic with more than a thousand pairs the matches only, and the first of the others.
        """
        known = self._pairs.get(topic)
        if known is None:
            known = self._pairs[topic] = tuple(self._find_pairs(topic))
        return known

    def sums(self, rows: Iterable[TopicRow]) -> Sums:
        """Of these rows; and the nodes that are not hidden."""
        shown = [*rows]
        return Sums(
            nodes=sum(not is_hidden_node(one.name) for one in self.graph.nodes),
            topics=len(shown),
            hz=sum(row.hz or 0.0 for row in shown),
            bytes_per_s=sum(row.bytes_per_s or 0.0 for row in shown),
            lost_per_s=sum(row.lost_per_s for row in shown),
            lost=sum(row.lost for row in shown),
        )

    def _topic(self, name: str, group: _Group) -> TopicRow:
        return TopicRow(topic=name, **self._fixed(group, name), **group.counted())

    def _fixed(self, group: _Group, topic: str = "") -> dict[str, Any]:
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

    def _endpoint(self, mine: _Counters) -> EndpointRow:
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
            depth=_depth(one.qos),
            dropped=counters.dropped,
            lost_per_s=mine.lost_per_s,
            routes=tuple(sorted(self._routes(one))),
            age=_ages([mine]),
        )

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
