"""Who publishes what to whom, how fast, and who loses what: rows out of graphs and their counters.

Pure: graphs and times come in, rows go out. `bus top` and the page both show them.
"""

from collections.abc import Iterable, Iterator, Mapping
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


_Ends = tuple[list[GraphEndpoint], list[GraphEndpoint]]
_NO_ENDS: _Ends = ([], [])


def _depth(qos: QoSProfile) -> int | None:
    return qos.depth if qos.history is History.KEEP_LAST else None


def _ages(told: list[tuple[int, int, int, int]]) -> Ages | None:
    if not told:
        return None
    number = sum(count for _, count, _, _ in told)
    return Ages(sum(sum_ns for _, _, sum_ns, _ in told) / number / _NS, max(most for *_, most in told) / _NS)


def _identity(graph: Graph) -> tuple[int, int]:
    return graph.revision, graph.broker_pid


class _Counters:
    """Of one endpoint, from look to look."""

    __slots__ = ("ages", "losses", "lost_per_s", "meter", "rates")

    def __init__(self) -> None:
        self.ages: tuple[int, int, int, int] | None = None  # when they were told; how many, sum, most
        self.meter = Meter()
        self.losses: list[tuple[int, int]] = []  # when, and how many in all: of the last seconds
        self.rates: tuple[float, ...] | None = None
        self.lost_per_s = 0.0

    def take(self, statistics: EndpointStatistics, now_ns: int) -> None:
        self.meter.add(statistics.at_ns, statistics.samples, statistics.bytes)
        self.rates = self.meter.rates(now_ns)
        if statistics.age_count:
            self.ages = (
                statistics.at_ns, statistics.age_count, statistics.age_sum_ns, statistics.age_max_ns,
            )  # fmt: skip
        elif self.ages is not None and now_ns - self.ages[0] > _NOW_NS:
            self.ages = None
        losses = self.losses
        lost = sum(statistics.dropped.values()) if statistics.dropped else 0
        if losses and losses[0][1] == lost:
            losses[:] = [(max(losses[0][0], now_ns - _NOW_NS), lost)]
            self.lost_per_s = 0.0
            return
        if losses and lost < losses[-1][1]:
            losses.clear()
        losses.append((now_ns, lost))
        while len(losses) > 2 and losses[1][0] <= now_ns - _NOW_NS:
            del losses[0]
        span_ns = now_ns - losses[0][0]
        self.lost_per_s = (lost - losses[0][1]) * _NS / span_ns if span_ns else 0.0


class Model:
    """The bus as it was at the last look, and how fast things went until then.

    `own` are the processes of those who look: their hidden nodes are left out. `describe` is asked where two
    types have one name.
    """

    def __init__(self, own: Iterable[int] = (), describe: Describe = lambda name, number: None) -> None:
        self._own = frozenset(own)
        self._describe = describe
        self._graph: Graph | None = None
        self._ends: dict[str, _Ends] = {}
        self._by_node: dict[int, _Ends] = {}
        self._counters: dict[bytes, _Counters] = {}
        self._histories: dict[str | int, Seconds] = {}
        """Of topics by name, and of nodes by their id."""
        self._matches: dict[int, list[GraphMatch]] = {}
        """By the ids of both ends."""
        self._pairs: dict[str, tuple[Pair, ...]] = {}
        self._fixed: dict[str | int, dict[str, Any]] = {}
        """Of rows, by name or id: what is the same as long as the graph is."""

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
        is_new = before is None or _identity(before) != _identity(graph)
        if is_new:
            self.forget_pairs()
            self._matches = {}
            for match in graph.matches:
                self._matches.setdefault(match.publisher, []).append(match)
                self._matches.setdefault(match.subscription, []).append(match)
        ends: dict[str, _Ends] = {}
        by_node: dict[int, _Ends] = {}
        counters = {}
        for number, endpoints in enumerate((graph.publishers, graph.subscriptions)):
            for one in endpoints:
                if one.node.pid in self._own and is_hidden_node(one.node.name):
                    continue
                mine = counters[one.gid] = self._counters.get(one.gid) or _Counters()
                mine.take(one.statistics or _NOTHING, now_ns)
                ends.setdefault(one.topic, ([], []))[number].append(one)
                by_node.setdefault(one.node.id, ([], []))[number].append(one)
        self._counters, self._ends = counters, {topic: ends[topic] for topic in sorted(ends)}
        self._by_node = by_node
        histories: dict[str | int, Seconds] = {}
        together: list[tuple[str | int, _Ends]] = [*self._ends.items(), *by_node.items()]
        for key, (publishers, _) in together:
            history = histories[key] = self._histories.get(key) or Seconds()
            rate = self._rate(publishers, 0)
            if rate is not None or history.values:  # what is not known yet is not nothing
                history.add(now_ns, rate or 0.0)
        self._histories = histories
        return is_new

    def forget_pairs(self) -> None:
        """`describe` knows more than when it was asked."""
        self._pairs = {}
        self._fixed = {}

    def topics(self, *, hidden: bool = False) -> list[TopicRow]:
        """A row for each topic, sorted by name; `hidden` ones too."""
        return [
            self._topic(name, *ends)
            for name, ends in self._ends.items()
            if hidden or not is_hidden_topic(name)
        ]

    def topic(self, name: str) -> TopicRow | None:
        """The row of one topic, by its full name; None where it is not there."""
        ends = self._ends.get(name)
        return None if ends is None else self._topic(name, *ends)

    def nodes(self, *, hidden: bool = False) -> list[NodeRow]:
        """A row for each node that has endpoints, sorted by name; `hidden` ones too."""
        nodes = sorted(self.graph.nodes, key=lambda one: (one.full_name, one.id))
        return [
            NodeRow(
                node=one.full_name,
                id=one.id,
                pid=one.pid,
                **self._fixed_of(one.id, ends),
                **self._counted(one.id, ends),
            )
            for one in nodes
            if (hidden or not is_hidden_node(one.name)) and (ends := self._by_node.get(one.id)) is not None
        ]

    def endpoints_of_node(self, number: int) -> list[EndpointRow]:
        """The publishers of a node, by its id in the graph, then its subscriptions; sorted by topic."""
        return [
            self._endpoint(one)
            for ends in self._by_node.get(number, _NO_ENDS)
            for one in sorted(ends, key=lambda one: one.topic)
        ]

    def endpoints(self, topic: str) -> list[EndpointRow]:
        """The publishers of a topic, then its subscriptions; none where it is not there."""
        publishers, subscriptions = self._ends.get(topic, _NO_ENDS)
        return [self._endpoint(one) for one in (*publishers, *subscriptions)]

    def all_endpoints(self) -> list[EndpointRow]:
        """Those of all topics, hidden ones too."""
        return [row for topic in self._ends for row in self.endpoints(topic)]

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

    def _topic(
        self, name: str, publishers: list[GraphEndpoint], subscriptions: list[GraphEndpoint]
    ) -> TopicRow:
        ends = (publishers, subscriptions)
        return TopicRow(topic=name, **self._fixed_of(name, ends), **self._counted(name, ends))

    def _fixed_of(self, key: str | int, ends: _Ends) -> dict[str, Any]:
        """The fields of a topic's or a node's row that change with the graph only."""
        if (known := self._fixed.get(key)) is not None:
            return known
        publishers, subscriptions = ends
        found: dict[str, Any] = {"publishers": len(publishers), "subscriptions": len(subscriptions)}
        if isinstance(key, str):
            found["types"] = tuple(sorted({one.type_name for one in (*publishers, *subscriptions)}))
            found["mismatches"] = sum(not pair.route for pair in self.pairs(key))
            matched = subscriptions
        else:
            found["mismatches"] = self._mismatches_of(ends)
            matched = [*publishers, *subscriptions]
        found["routes"] = tuple(sorted({route for one in matched for route in self._routes(one)}))
        self._fixed[key] = found
        return found

    def _counted(self, key: str | int, ends: _Ends) -> dict[str, Any]:
        """The fields that rows have in common and that change with every look."""
        publishers, subscriptions = ends
        dropped: dict[str, int] = {}
        queued, most, depth, lost_per_s = 0, -1, None, 0.0
        ages = []
        for one in subscriptions:
            counters, mine = one.statistics or _NOTHING, self._counters[one.gid]
            for reason, count in counters.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + count
            queued += counters.queued
            if counters.queued > most:
                most, depth = counters.queued, _depth(one.qos)
            lost_per_s += mine.lost_per_s
            if mine.ages is not None:
                ages.append(mine.ages)
        return {
            "hz": self._rate(publishers, 0),
            "bytes_per_s": self._rate(publishers, 1),
            "history": self._histories[key].values,
            "queued": queued,
            "depth": depth,
            "age": _ages(ages),
            "lost_per_s": lost_per_s,
            "dropped": dropped,
        }

    def _mismatches_of(self, ends: _Ends) -> int:
        mine = {one.id for some in ends for one in some}
        return sum(
            not pair.route and (pair.publisher in mine or pair.subscription in mine)
            for topic in {one.topic for some in ends for one in some}
            for pair in self.pairs(topic)
        )

    def _endpoint(self, one: GraphEndpoint) -> EndpointRow:
        counters, mine = one.statistics or _NOTHING, self._counters[one.gid]
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
            age=_ages([mine.ages] if mine.ages is not None else []),
        )

    def _routes(self, one: GraphEndpoint) -> set[str]:
        return {match.route for match in self._matches.get(one.id, ())}

    def _rate(self, publishers: Iterable[GraphEndpoint], which: int) -> float | None:
        known = [rates[which] for one in publishers if (rates := self._counters[one.gid].rates) is not None]
        return sum(known) if known else None

    def _find_pairs(self, topic: str) -> Iterator[Pair]:
        publishers, subscriptions = self._ends.get(topic, _NO_ENDS)
        if not publishers or not subscriptions:
            return
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
