"""bus_cli.metrics.families: names, labels and bounds; docs/operation.md has all of them."""

import os
import re
from pathlib import Path

import pytest

pytest.importorskip("prometheus_client")

from prometheus_client import generate_latest
from prometheus_client.core import Metric
from prometheus_client.openmetrics.exposition import generate_latest as open_metrics
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_open_metrics
from prometheus_client.parser import text_string_to_metric_families
from prometheus_client.registry import CollectorRegistry

from bus.graph import Graph
from bus.wire import messages as m
from bus_cli.metrics.families import BusCollector
from bus_cli.metrics.view import View
from metrics_views import PUBLISHER, SUBSCRIPTION, endpoint, graph, view
from rows import for_each

DOCS = Path(__file__).parents[4] / "docs" / "operation.md"

CHARGES = m.Peers(
    request=1,
    peers=(
        m.PeerRecord(
            id=1, pid=1001, uid=7, program="cam.py", nodes=1, endpoints=2, queued_bytes=30, silent_s=2
        ),
        m.PeerRecord(id=2, pid=1001, uid=7, program="cam.py", nodes=2, queued_bytes=12, silent_s=1),
    ),
    users=(m.UserRecord(uid=7, connections=2, queued_bytes=42, refused=3),),
    routing=m.RoutingRecord(
        runs=5, samples=50, bytes=500, bounds_us=(4, 16), counts=(1, 2, 1), total_us=2_000_000
    ),
    limits={"connections": 256, "lease_s": 10.0},
)
CHATTER = graph(
    endpoint(1, PUBLISHER, samples=12, size=120, replaced=1),
    endpoint(2, SUBSCRIPTION, node=2, samples=9, size=90, queued=1, expected=12, replaced=2),
    endpoint(3, SUBSCRIPTION, node=2, samples=1, queued=4),
    endpoint(4, PUBLISHER, "/x/_action/status", samples=1),
    matches=(
        m.MatchRecord(publisher=1, subscription=2, route="shm"),
        m.MatchRecord(publisher=1, subscription=3),
    ),
)


def registry(*looks: View | str, most_rows: int = 100, hidden: bool = False) -> CollectorRegistry:
    """A registry that sees the views one after the other."""
    rest = iter(looks)
    found = CollectorRegistry()
    found.register(BusCollector(lambda: next(rest), most_rows=most_rows, hidden=hidden))
    return found


def samples(registry: CollectorRegistry) -> dict[str, float]:
    """Samples as Prometheus reads them: `name{label=value,...}`."""
    found = {}
    for family in text_string_to_metric_families(generate_latest(registry).decode()):
        for sample in family.samples:
            labels = ",".join(f"{name}={value}" for name, value in sorted(sample.labels.items()))
            found[f"{sample.name}{{{labels}}}" if labels else sample.name] = sample.value
    return found


def test_topics_and_nodes() -> None:
    found = samples(registry(view(CHATTER)))
    assert found["busd_up"] == 1
    assert found["busd_build_info{protocol=1,version=0.1.0}"] == 1
    assert found["busd_nodes"] == 2
    assert found["busd_topic_messages_total{topic=/chatter}"] == 12
    assert found["busd_topic_bytes_total{topic=/chatter}"] == 120
    assert found["busd_publishers{topic=/chatter}"] == 1
    assert found["busd_subscriptions{topic=/chatter}"] == 2
    assert found["busd_matches{route=shm,topic=/chatter}"] == 1
    assert found["busd_matches{route=socket,topic=/chatter}"] == 1
    assert found["busd_expected_total{node=/n2,topic=/chatter}"] == 12
    assert found["busd_delivered_total{node=/n2,topic=/chatter}"] == 10
    assert found["busd_delivered_bytes_total{node=/n2,topic=/chatter}"] == 90
    assert found["busd_lost_total{node=/n2,topic=/chatter}"] == 2
    assert found["busd_dropped_total{node=/n2,reason=replaced,topic=/chatter}"] == 2
    assert found["busd_publisher_dropped_total{node=/n1,reason=replaced,topic=/chatter}"] == 1
    assert found["busd_queue_samples{node=/n2,topic=/chatter}"] == 5


def test_hidden_topics_only_where_they_are_wanted() -> None:
    name = "busd_topic_messages_total{topic=/x/_action/status}"
    assert name not in samples(registry(view(CHATTER)))
    assert samples(registry(view(CHATTER), hidden=True))[name] == 1


def test_charges() -> None:
    found = samples(registry(view(CHATTER, CHARGES)))
    who = "{pid=1001,program=cam.py,uid=7}"
    assert found[f"busd_peer_nodes{who}"] == 3  # the sum of all its connections
    assert found[f"busd_peer_queued_bytes{who}"] == 42
    assert found[f"busd_peer_silent_seconds{who}"] == 2
    assert found["busd_user_connections{uid=7}"] == 2
    assert found["busd_user_refused_total{uid=7}"] == 3
    assert found["busd_limit{limit=connections}"] == 256


def test_this_process_is_not_shown() -> None:
    ours = m.PeerRecord(id=3, pid=os.getpid(), uid=7, program="bus")
    seen = view(CHATTER, m.Peers(request=1, peers=(*CHARGES.peers, ours), users=()))
    assert not [name for name in samples(registry(seen)) if "program=bus" in name]


def test_the_histogram_of_routing() -> None:
    found = samples(registry(view(CHATTER, CHARGES)))
    assert found["busd_routing_seconds_bucket{le=4e-06}"] == 1
    assert found["busd_routing_seconds_bucket{le=1.6e-05}"] == 3
    assert found["busd_routing_seconds_bucket{le=+Inf}"] == 4
    assert found["busd_routing_seconds_count"] == 4
    assert found["busd_routing_seconds_sum"] == 2
    assert found["busd_routed_runs_total"] == 5
    assert found["busd_routed_messages_total"] == 50
    assert found["busd_routed_bytes_total"] == 500


def test_a_busd_that_routed_nothing_or_does_not_tell() -> None:
    charges = m.Peers(request=1, peers=(), users=())
    assert samples(registry(view(CHATTER, charges)))["busd_routing_seconds_count"] == 0
    assert "busd_routing_seconds_count" not in samples(registry(view(CHATTER)))


def test_no_busd() -> None:
    """When busd is back, counters continue at their old values."""
    both = registry(view(CHATTER), "no busd listens", view(CHATTER))
    before = samples(both)
    assert samples(both) == {"busd_up": 0}
    after = samples(both)
    name = "busd_topic_messages_total{topic=/chatter}"
    assert after[name] == before[name] == 12


def test_to_register_is_not_to_look() -> None:
    registry()  # would raise StopIteration


def many(count: int) -> Graph:
    return graph(
        *(endpoint(at, PUBLISHER, f"/t{at}") for at in range(1, count + 1)),
        *(endpoint(100 + at, SUBSCRIPTION, f"/t{at}", node=at, replaced=1) for at in range(1, count + 1)),
    )


def test_rows_are_bounded() -> None:
    found = samples(registry(view(many(12)), most_rows=10))
    for name in ("busd_topic_messages_total", "busd_publishers", "busd_queue_samples", "busd_dropped_total"):
        rows = [one for one in found if one.startswith(f"{name}{{")]
        assert len(rows) == 10, name
        assert found[f"busd_rows_left_out{{metric={name}}}"] == 2
    assert not [one for one in samples(registry(view(many(10)), most_rows=10)) if "left_out" in one]


def test_names_that_want_to_break_the_text() -> None:
    peer = m.PeerRecord(id=1, pid=1, uid=1, program='a"} 1\nbusd_up 0\\')
    rogue = registry(view(CHATTER, m.Peers(request=1, peers=(peer,), users=())))
    text = generate_latest(rogue).decode()
    families = {one.name: one for one in text_string_to_metric_families(text)}
    assert [one.value for one in families["busd_up"].samples] == [1]
    (nodes,) = families["busd_peer_nodes"].samples
    assert nodes.labels["program"] == peer.program


def test_open_metrics() -> None:
    text = open_metrics(registry(view(CHATTER, CHARGES))).decode()
    assert "busd_routing_seconds" in {family.name for family in parse_open_metrics(text)}


def families() -> dict[str, Metric]:
    seen = view(many(12), CHARGES)
    return {family.name: family for family in registry(seen, most_rows=10).collect()}


@for_each("name", sorted(families()))
def test_names_follow_the_rules(name: str) -> None:
    family = families()[name]
    assert re.fullmatch(r"busd_[a-z_]+", name)
    assert not re.search(r"_(ms|us|s|mib|kib|count|total)$", name), "base units; suffixes are the type's"
    assert family.documentation.endswith(".") or "--max-rows" in family.documentation


def test_the_page_has_all_of_them() -> None:
    described = {}
    for line in DOCS.read_text().splitlines():
        if line.startswith("| `busd_"):
            names, kind, labels, _ = (cell.strip() for cell in line.strip("|").split("|"))
            for name in re.findall(r"`(\w+)`", names):
                described[name] = (kind, tuple(re.findall(r"`(\w+)`", labels)))
    suffix = {"counter": "_total", "info": "_info"}
    seen = {}
    for name, family in families().items():
        if not name.startswith("busd_process_"):
            labels = (
                tuple(label for label in family.samples[0].labels if label != "le") if family.samples else ()  # type: ignore[assignment]
            )
            kind = "gauge" if family.type == "info" else family.type
            seen[name + suffix.get(family.type, "")] = (kind, labels)
    assert {name: kind for name, (kind, _) in seen.items()} == {
        name: kind for name, (kind, _) in described.items()
    }
    for name, (_, labels) in seen.items():
        if labels:
            assert set(labels) == set(described[name][1]), name
