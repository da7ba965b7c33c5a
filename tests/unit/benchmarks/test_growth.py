"""benchmarks/growth.py and benchmarks/discovery.py: their figures and comparisons, and both measured with few
topics.
"""

from collections import Counter
from typing import Any

import pytest

from benchmarks import discovery, growth
from benchmarks.adapters.discovering import Share
from benchmarks.adapters.growing import Load
from benchmarks.cases import Figures
from benchmarks.harness import Failure
from benchmarks.plan import Plan
from benchmarks.systems import BUS, BUS_SOCKET, System

pytestmark = pytest.mark.landing


@pytest.mark.parametrize(("processes", "topics"), [(3, 8), (20, 250), (20, 1000)])
def test_each_topic_has_one_publisher_and_one_subscription_in_another_process(
    processes: int, topics: int
) -> None:
    shares = [Share(index, processes, topics) for index in range(processes)]

    published = Counter(topic for share in shares for topic in share.published())
    heard = Counter(topic for share in shares for topic in share.heard())

    assert published == heard == Counter(f"topic_{number}" for number in range(topics))
    assert not any(set(share.published()) & set(share.heard()) for share in shares)


def test_each_process_hears_all_others() -> None:
    shares = [Share(index, 20, 1000) for index in range(20)]
    publishers = {topic: share.index for share in shares for topic in share.published()}

    for share in shares:
        assert {publishers[topic] for topic in share.heard()} == set(range(20)) - {share.index}


def test_a_load_knows_what_comes_where() -> None:
    load = Load(topics=10, subscriptions=16, processes=4, rate=200.0, seconds=0.5)

    assert (load.count, load.warm_up, load.in_each) == (100, 100, 4)
    assert load.work(load.in_each).total == 400
    assert Load(topics=1000).warm_up == 1000  # each topic gets a message


def test_growth_measures_what_several_begin_with_once_and_shows_it_in_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured: list[tuple[str, Load]] = []

    def measure(system: System, load: Load) -> Figures:
        measured.append((system.name, load))
        if load.nodes > 1:
            raise Failure("no")
        return {"cpu": float(load.topics), "p50": 1.0, "endpoint_us": float(load.endpoints)}

    monkeypatch.setattr(growth, "measure", measure)
    monkeypatch.setattr(growth, "measure_endpoints", measure)
    monkeypatch.setattr(growth, "BUS", BUS._replace(missing=str))  # also without shared memory

    section = growth.run(Plan(quick=True, repetitions=1))

    assert len(measured) == len(set(measured))
    rows = {row.name: row for row in section.rows}
    assert len(rows) == len(section.rows) > len(measured)
    assert rows["1 topics: busd, shared memory"].figures == rows["1 nodes: busd, shared memory"].figures
    assert (rows["1000 topics: busd, shared memory"].series, rows["1000 topics: busd, shared memory"].at) == (
        "topics: busd, shared memory",
        1000,
    )
    assert rows["50 nodes: busd, shared memory"].trouble == "failed: no"
    ratios = {one.name: one.value.median for one in section.comparisons}
    assert ratios["topics: busd, shared memory, 1000 / 1: CPU per delivery"] == 1000
    assert ratios["endpoints of a process: busd, shared memory, 1000 / 10: time per endpoint"] == 100
    assert not any("nodes" in name for name in ratios)


def test_growth_counts_all_deliveries_of_all_processes() -> None:
    load = Load(topics=3, nodes=2, subscriptions=4, processes=2, rate=400.0, seconds=0.1)

    found = growth.measure(BUS_SOCKET, load)

    assert 0 < found["p50"] <= found["p99"]
    total = found["cpu_publisher"] + found["cpu_broker"] + 4 * found["cpu_subscriber"]
    assert 4 * found["cpu"] == pytest.approx(total)


def test_growth_declares_endpoints() -> None:
    found = growth.measure_endpoints(BUS_SOCKET, Load(endpoints=4))

    assert min(found["endpoint_us"], found["endpoint_cpu"]) > 0


@pytest.mark.parametrize("at_once", [False, True])
def test_discovery_waits_until_all_is_matched_and_lists_it(at_once: bool) -> None:
    found = discovery.measure(BUS_SOCKET, 8, processes=3, at_once=at_once, listings=int(not at_once))

    assert 0 < found["declared_s"] <= found["matched_s"]
    assert found["us_per_endpoint"] == pytest.approx(found["matched_s"] * 1e6 / 16)
    assert ("list_ms" in found) == ("empty_ms" in found) == (not at_once)


def test_discovery_compares_many_topics_with_few(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(system: System, topics: int, **how: Any) -> Figures:
        listed = {"list_ms": 90.0, "empty_ms": 60.0} if how["listings"] else {}
        return {"matched_s": topics / 1000, "us_per_endpoint": 500.0 + topics} | listed

    monkeypatch.setattr(discovery, "measure", measure)
    monkeypatch.setattr(discovery, "BUS", BUS._replace(missing=str))

    section = discovery.run(Plan(quick=True, repetitions=1))

    assert [row.at for row in section.rows] == [250, 1000]
    assert [round(one.value.median, 3) for one in section.comparisons] == [1.0, 2.0, 1.5]
    assert [one.is_met for one in section.comparisons] == [True, False, True]
