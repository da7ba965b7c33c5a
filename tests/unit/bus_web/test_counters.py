"""The counters of one endpoint: rates, recent losses, ages; and the sums of several endpoints."""

from typing import Any

from bus.graph import EndpointStatistics, GraphEndpoint, GraphNode
from bus.qos import History, QoSProfile
from bus_plot.loss_timeline import LossTimeline, Slot
from bus_web.counters import Counters, Group, age_parts_of, ages_of, depth_of
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


def test_losses_keep_their_time_and_those_of_the_first_look_have_none() -> None:
    counters = Counters()
    for second, lost in enumerate((5, 5, 8, 8, 12)):
        counters.take(counted(dropped={"replaced": lost}), (10 + second) * S)
    assert counters.timeline is not None
    assert counters.timeline.earlier == {"replaced": 5}
    assert counters.timeline.slots() == [Slot(12, 1, {"replaced": 3}), Slot(14, 1, {"replaced": 4})]
    late = Counters()
    late.take(counted(dropped={"replaced": 2}), 20 * S, 19 * S)
    assert late.timeline is not None
    assert late.timeline.slots() == [Slot(20, 1, {"replaced": 2})], "it has come since the last look"
    assert late.lost_per_s == 0.0


def test_a_restarted_busd_knows_the_losses_again_only_with_the_next_report() -> None:
    counters = Counters()
    seen = []
    reports: tuple[tuple[int, dict[str, int]], ...] = (
        (S, {"replaced": 5}),
        (2 * S, {"replaced": 9}),
        (0, {}),
        (0, {"expired": 1}),
        (6 * S, {"replaced": 11}),
    )
    for second, (at_ns, dropped) in enumerate(reports):
        counters.take(counted(at_ns=at_ns, dropped=dropped), (10 + second) * S)
        seen.append((sum(counters.dropped.values()), counters.new_losses))
    assert seen == [(5, {"replaced": 5}), (9, {"replaced": 4}), (9, {}), (9, {}), (11, {"replaced": 2})]
    counters.take(counted(at_ns=7 * S, dropped={"replaced": 3}), 15 * S)
    assert (counters.dropped, counters.new_losses) == ({"replaced": 3}, {"replaced": 0}), "its own figures"
    counters.take(counted(at_ns=8 * S, dropped={"replaced": 4}), 16 * S)
    assert counters.new_losses == {"replaced": 1}


def test_ages_are_of_late() -> None:
    counters = Counters()
    counters.take(counted(at_ns=S, age_count=2, age_sum_ns=30, age_max_ns=20), S)
    assert ages_of([counters]) == Ages(15e-9, 20e-9)
    nothing = counted(at_ns=2 * S)
    counters.take(nothing, 4 * S)
    assert ages_of([counters]) is not None
    counters.take(nothing, 4 * S + 1)
    assert ages_of([counters]) is None


def test_p50_and_p99_are_of_the_last_ten_seconds() -> None:
    counters, other = Counters(), Counters()

    def report(second: int, *parts: int) -> list[int]:
        """p50 and p99 in nanoseconds."""
        age = {"age_count": sum(parts), "age_sum_ns": S, "age_max_ns": S, "age_parts": parts}
        counters.take(counted(at_ns=second * S, **age), second * S)
        counters.take(counted(at_ns=second * S, **age), second * S)  # the same report, seen again
        ages = ages_of([counters])
        assert ages is not None
        assert (ages.mean, ages.most) == (1 / sum(parts), 1.0)
        assert ages.p50 is not None
        assert ages.p99 is not None
        return [round(ages.p50 * S), round(ages.p99 * S)]

    assert report(1, 0, 0, 0, 10) == [2560, 3062]
    assert report(5, 0, 10) == [1536, 3052]
    assert age_parts_of([counters])[:4] == [0, 10, 0, 10]
    assert report(11, 10) == [1024, 1526], "the first is over"
    assert age_parts_of([counters, other])[:4] == [10, 10, 0, 0]
    counters.take(counted(at_ns=12 * S), 15 * S)
    assert (ages_of([counters]), sum(age_parts_of([counters]))) == (None, 0)


def test_several_together() -> None:
    assert ages_of(()) is None
    group = Group(RateHistory(), is_hidden=False)
    for number in (1, 3):
        counters = Counters()
        age = {"at_ns": S, "age_count": number, "age_sum_ns": 2 * S, "age_max_ns": S * 2 // number}
        counters.take(counted(queued=number, dropped={"replaced": number}, **age), S)
        group.subscriptions.append(counters)
    fields = group.counted()
    assert (fields["queued"], fields["depth"], fields["dropped"]) == (3, 7, {"replaced": 4})
    assert fields["age"] == Ages(1.0, 2.0)
    assert (fields["hz"], fields["history"]) == (None, ())


def test_losses_of_a_group_second_by_second() -> None:
    topic, node = Group(RateHistory(), LossTimeline(), is_hidden=False), Group(RateHistory(), is_hidden=False)
    counters = Counters()
    for group in (topic, node):
        group.subscriptions.append(counters)
    for second, lost in enumerate((1, 1, 4, 4)):
        counters.take(counted(dropped={"replaced": lost}), (100 + second) * S)
        for group in (topic, node):
            group.add((100 + second) * S)
            assert group.counted()["lost_history"][-2:] == {2: (0.0, 3.0), 3: (3.0, 0.0)}.get(second, ())
    assert [group.counted()["lost_in_all"] for group in (topic, node)] == [4, 4]
    assert len(topic.counted()["lost_history"]) == 60
    topic.subscriptions.clear()
    assert topic.counted()["lost_in_all"] == 4, "it has left, and its losses stay"


def test_depth() -> None:
    assert depth_of(QoSProfile(7)) == 7
    assert depth_of(QoSProfile(history=History.KEEP_ALL)) is None
