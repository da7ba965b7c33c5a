"""The counters of one endpoint: rates, recent losses, ages; and the sums of several endpoints."""

from typing import Any

from bus.graph import EndpointStatistics, GraphEndpoint, GraphNode
from bus.qos import History, QoSProfile
from bus_web.counters import Counters, Group, ages_of, depth_of
from bus_web.rates import RateHistory
from bus_web.rows import Ages

S = 1_000_000_000


def counted(**counters: Any) -> GraphEndpoint:
    node = GraphNode(1, "a", "/", 1)
    statistics = EndpointStatistics(**counters)
    return GraphEndpoint(
        1, "subscription", node, "/x", "a/msg/B", "h", bytes(16), QoSProfile(7), statistics=statistics
    )


def test_rates_come_with_the_second_report() -> None:
    counters = Counters()
    counters.take(counted(samples=10, bytes=100, at_ns=S), S)
    assert counters.rates is None
    counters.take(counted(samples=30, bytes=300, at_ns=2 * S), 2 * S)
    assert counters.rates == (20.0, 200.0)


def test_what_is_lost_now_and_what_was_lost_before() -> None:
    counters = Counters()
    seen = []
    for second, lost in enumerate((5, 5, 8, 8, 8, 8, 2)):
        counters.take(counted(dropped={"replaced": lost}), (10 + second) * S)
        seen.append(counters.lost_per_s > 0)
    assert seen == [False, False, True, True, True, False, False], "fewer than before: busd was restarted"


def test_ages_are_of_late() -> None:
    counters = Counters()
    counters.take(counted(at_ns=S, age_count=2, age_sum_ns=30, age_max_ns=20), S)
    assert ages_of([counters]) == Ages(15e-9, 20e-9)
    nothing = counted(at_ns=2 * S)
    counters.take(nothing, 4 * S)
    assert ages_of([counters]) is not None
    counters.take(nothing, 4 * S + 1)
    assert ages_of([counters]) is None


def test_several_together() -> None:
    assert ages_of(()) is None
    group = Group(RateHistory(), is_hidden=False)
    for number in (1, 3):
        counters = Counters()
        age = {"at_ns": S, "age_count": number, "age_sum_ns": 2 * S, "age_max_ns": S * 2 // number}
        counters.take(counted(queued=number, dropped={"replaced": number}, **age), S)
        group.subscriptions.append(counters)
    fields = group.counted()
    assert (fields["queued"], fields["depth"], fields["dropped"]) == (4, 7, {"replaced": 4})
    assert fields["age"] == Ages(1.0, 2.0)
    assert (fields["hz"], fields["history"]) == (None, ())


def test_depth() -> None:
    assert depth_of(QoSProfile(7)) == 7
    assert depth_of(QoSProfile(history=History.KEEP_ALL)) is None
