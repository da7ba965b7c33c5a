"""Metrics for Prometheus from one view of the bus. Needs prometheus-client.

Owns names, help texts, labels, and the limit of rows of each metric. Must not know the server.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

from prometheus_client import ProcessCollector
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.registry import Collector

from bus.graph import Graph
from bus.names import is_hidden_topic
from bus.wire.messages import PeerRecord, RoutingRecord, UserRecord
from bus_cli.metrics.bridges import BridgeTotals, links, waiting
from bus_cli.metrics.sums import Labels, Sums, Totals
from bus_cli.metrics.view import View

if TYPE_CHECKING:  # the module imports the node, which is slow
    from bus_cli.bridge.remote import Answer

__all__ = ["BusCollector"]

_NODE = ("topic", "node")
_DROP = (*_NODE, "reason")
_ROUTE = ("bridge", "direction", "topic")
_PEER = ("pid", "program", "uid")

_OF_PEERS = {
    "nodes": "Nodes of a process.",
    "endpoints": "Publishers and subscriptions of a process.",
    "topics": "Topics that the endpoints of a process are on.",
    "matches": "Matches that the endpoints of a process take part in.",
    "descriptors": "File descriptors that busd holds for a process.",
    "queued_bytes": "Bytes of messages that wait in busd for a process.",
    "history_bytes": "Bytes of transient local history that busd keeps for a process.",
    "control_bytes": "Bytes of control frames that wait in busd for a process.",
}
_OF_USERS = {
    "connections": "Connected processes of a user.",
    "endpoints": "Publishers and subscriptions of a user.",
    "topics": "Topics that the endpoints of a user are on.",
    "descriptors": "File descriptors that busd holds for a user.",
    "queued_bytes": "Bytes of messages that wait in busd for a user's processes.",
    "history_bytes": "Bytes of transient local history that busd keeps for a user's processes.",
    "absent": "Lost subscriptions of a user for which busd counts missed messages.",
}

Numbers = Mapping[Labels, float]
Record = TypeVar("Record", PeerRecord, UserRecord)


class BusCollector(Collector):
    """Looks at the bus for each scrape. `look` returns the view, or the reason why there is none."""

    def __init__(self, look: Callable[[], View | str], *, most_rows: int, hidden: bool) -> None:
        self._look = look
        self._lock = Lock()  # protects the sums, which threads share
        self._most = most_rows
        self._hidden = hidden
        self._totals = Totals(most_rows)
        self._of_bridges = BridgeTotals(most_rows)
        self._left_out: dict[Labels, float] = {}

    def describe(self) -> Iterable[Metric]:
        """Returns nothing, because registration must not look at the bus."""
        return ()

    def collect(self) -> list[Metric]:
        with self._lock:
            return list(self._families())

    def _families(self) -> Iterator[Metric]:
        seen = self._look()
        is_up = isinstance(seen, View)
        yield GaugeMetricFamily("busd_up", "Whether busd answered (1) or not (0).", float(is_up))
        if isinstance(seen, View):
            self._left_out = {}
            yield from self._about_busd(seen)
            yield from self._about_topics(seen.graph)
            yield from self._about_charges(seen)
            yield from self._about_bridges(seen.bridges)
            yield _gauge(
                "busd_rows_left_out",
                f"Rows of a metric above the first {self._most}, if there are any (--max-rows).",
                ("metric",),
                self._left_out,
            )

    def _about_busd(self, seen: View) -> Iterator[Metric]:
        hello = seen.hello
        yield InfoMetricFamily(
            "busd_build",
            "The daemon's release and its version of the protocol.",
            {"version": hello.release, "protocol": str(hello.version)},
        )
        yield GaugeMetricFamily("busd_look_seconds", "How long busd took to answer.", seen.seconds)
        yield GaugeMetricFamily("busd_nodes", "Nodes on the bus.", len(seen.graph.nodes))
        yield from ProcessCollector(namespace="busd", pid=lambda: hello.pid, registry=None).collect()

    def _about_topics(self, graph: Graph) -> Iterator[Metric]:
        publishers = [one for one in graph.publishers if self._shows(one.topic)]
        subscriptions = [one for one in graph.subscriptions if self._shows(one.topic)]
        totals = self._totals
        totals.take(publishers, subscriptions)
        for name, text, labels, sums in (
            ("busd_topic_messages_total", "Messages published.", _NODE[:1], totals.messages),
            ("busd_topic_bytes_total", "Bytes published, encoded.", _NODE[:1], totals.bytes),
            ("busd_expected_total", "Messages published to a node.", _NODE, totals.expected),
            ("busd_delivered_total", "Messages that a node's program has taken.", _NODE, totals.delivered),
            ("busd_delivered_bytes_total", "Bytes of these, encoded.", _NODE, totals.delivered_bytes),
            ("busd_lost_total", "Messages that a node lost.", _NODE, totals.lost),
            ("busd_dropped_total", "Messages that a node lost, by reason.", _DROP, totals.dropped),
            (
                "busd_publisher_dropped_total",
                "Messages replaced in a publisher's own queue before they left its process. "
                "Subscriptions count them too, as publisher_queue.",
                _DROP,
                totals.dropped_early,
            ),
        ):
            yield self._counter(name, text, labels, sums)
        waiting: dict[Labels, float] = {}
        for one in subscriptions:
            labels = (one.topic, one.node.full_name)
            queued = one.statistics.queued if one.statistics else 0
            waiting[labels] = waiting.get(labels, 0) + queued
        yield self._gauge("busd_queue_samples", "Messages that wait for a node's program.", _NODE, waiting)
        for name, text, endpoints in (
            ("busd_publishers", "Publishers on a topic.", publishers),
            ("busd_subscriptions", "Subscriptions on a topic.", subscriptions),
        ):
            yield self._gauge(name, text, _NODE[:1], _count((one.topic,) for one in endpoints))
        topics = {one.id: one.topic for one in publishers}
        matches = _count(
            (topics[one.publisher], one.route) for one in graph.matches if one.publisher in topics
        )
        text = "Publishers and subscriptions between which messages flow, by route."
        yield self._gauge("busd_matches", text, ("topic", "route"), matches)

    def _shows(self, topic: str) -> bool:
        return self._hidden or not is_hidden_topic(topic)

    def _about_charges(self, seen: View) -> Iterator[Metric]:
        if seen.charges is None:
            return
        yield from _about_routing(seen.charges.routing)
        absent = seen.charges.absent
        text = "Messages kept for lost subscriptions that did not reconnect."
        yield CounterMetricFamily("busd_unclaimed_messages_total", text, absent.unclaimed)
        text = "Lost subscriptions without room for their counts of missed messages."
        yield CounterMetricFamily("busd_absent_given_up_total", text, absent.given_up)
        limits: Numbers = {(name,): float(value) for name, value in seen.charges.limits.items()}
        yield self._gauge("busd_limit", "Limits in busd.toml.", ("limit",), limits)
        us, users = os.getpid(), seen.charges.users
        peers = [peer for peer in seen.charges.peers if peer.pid != us]
        for name, text in _OF_PEERS.items():
            yield self._gauge(f"busd_peer_{name}", text, _PEER, _sum(_peer, peers, name))
        yield self._gauge(
            "busd_peer_silent_seconds",
            "Seconds since busd last heard from a process.",
            _PEER,
            {_peer(one): one.silent_s for one in sorted(peers, key=lambda one: one.silent_s)},
        )
        for name, text in _OF_USERS.items():
            yield self._gauge(f"busd_user_{name}", text, ("uid",), _sum(_user, users, name))
        text = "Number of requests of a user's processes that busd refused because of a limit."
        refused = CounterMetricFamily("busd_user_refused_total", text, labels=("uid",))
        for user, count in self._bounded("busd_user_refused_total", _sum(_user, users, "refused")).items():
            refused.add_metric(user, count)
        yield refused

    def _about_bridges(self, bridges: "Mapping[str, Answer]") -> Iterator[Metric]:
        totals = self._of_bridges
        totals.take(bridges)
        for name, text, labels, sums in (
            ("busd_bridge_taken_total", "Messages that a bridge took.", _ROUTE, totals.taken),
            ("busd_bridge_sent_total", "Messages that a bridge sent on.", _ROUTE, totals.sent),
            ("busd_bridge_sent_bytes_total", "Bytes of these, encoded.", _ROUTE, totals.bytes),
            (
                "busd_bridge_dropped_total",
                "Messages that a bridge took and dropped, by reason.",
                (*_ROUTE, "reason"),
                totals.dropped,
            ),
            (
                "busd_bridge_lost_total",
                "Messages that were sent to a bridge and never arrived.",
                _ROUTE,
                totals.lost,
            ),
            (
                "busd_bridge_refused_total",
                "Connections that a bridge refused before it knew which bus asks.",
                ("bridge",),
                totals.refused,
            ),
        ):
            yield self._counter(name, text, labels, sums)
        yield self._gauge("busd_bridge_waiting", "Messages that wait in a bridge.", _ROUTE, waiting(bridges))
        text = "Links of a bridge, and addresses that it tries to reach, by state."
        yield self._gauge("busd_bridge_links", text, ("bridge", "state"), links(bridges))

    def _gauge(self, name: str, text: str, labels: tuple[str, ...], rows: Numbers) -> Metric:
        return _gauge(name, text, labels, self._bounded(name, rows))

    def _counter(self, name: str, text: str, labels: tuple[str, ...], sums: Sums) -> Metric:
        if sums.left_out:
            self._left_out[(name,)] = sums.left_out
        family = CounterMetricFamily(name, text, labels=labels)
        for values, number in sums.rows.items():
            family.add_metric(values, number)
        return family

    def _bounded(self, name: str, rows: Numbers) -> Numbers:
        """The first rows, which belong to the oldest endpoints and processes."""
        if len(rows) <= self._most:
            return rows
        self._left_out[(name,)] = len(rows) - self._most
        return dict([*rows.items()][: self._most])


def _about_routing(routing: RoutingRecord) -> Iterator[Metric]:
    for name, text, value in (
        ("runs", "Runs of messages that went through busd, the route socket.", routing.runs),
        ("messages", "Messages that went through busd, the route socket.", routing.samples),
        ("bytes", "Bytes of these, encoded.", routing.bytes),
    ):
        yield CounterMetricFamily(f"busd_routed_{name}_total", text, value)
    bounds = [repr(bound / 1e6) for bound in routing.bounds_us] + ["+Inf"]
    sums, buckets = 0, []
    for bound, count in zip(bounds, routing.counts or [0] * len(bounds), strict=True):
        sums += count
        buckets.append((bound, sums))
    yield HistogramMetricFamily(
        "busd_routing_seconds",
        "Time that messages spend in busd: from a read of a publisher's socket until all messages of that "
        "read were handed on. Counts reads.",
        buckets,
        routing.total_us / 1e6,
    )


def _gauge(name: str, text: str, labels: tuple[str, ...], rows: Numbers) -> Metric:
    family = GaugeMetricFamily(name, text, labels=labels)
    for values, number in rows.items():
        family.add_metric(values, number)
    return family


def _count(rows: Iterable[Labels]) -> Numbers:
    counts: dict[Labels, float] = {}
    for labels in rows:
        counts[labels] = counts.get(labels, 0) + 1
    return counts


def _sum(labels_of: Callable[[Record], Labels], records: Iterable[Record], name: str) -> Numbers:
    """A field of the records; the sum if several records have the same labels."""
    sums: dict[Labels, float] = {}
    for record in records:
        labels = labels_of(record)
        sums[labels] = sums.get(labels, 0) + getattr(record, name)
    return sums


def _peer(peer: PeerRecord) -> Labels:
    return (str(peer.pid), peer.program, str(peer.uid))


def _user(user: UserRecord) -> Labels:
    return (str(user.uid),)
