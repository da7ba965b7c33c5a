"""Rows of topics and endpoints: rates, losses, routes, and mismatches with their reasons."""

from typing import Any

from msgspec.structs import replace

from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphMatch, GraphNode
from bus.qos import History, QoSProfile, Reliability
from bus_web.model import Model
from bus_web.rows import Ages, Pair

S = 1_000_000_000
TALKER = GraphNode(1, "talker", "/", 10)
LISTENER = GraphNode(2, "listener", "/ns", 20)
TOOL = GraphNode(3, "_bus_web_30", "/", 30)


def endpoint(
    number: int, kind: str, node: GraphNode, topic: str = "/chatter", **others: Any
) -> GraphEndpoint:
    given = {"type_name": "std_msgs/msg/String", "type_hash": "h", "qos": QoSProfile(7), **others}
    return GraphEndpoint(number, kind, node, topic, gid=bytes([number]) * 16, **given)


def graph(*ends: GraphEndpoint, matches: tuple[GraphMatch, ...] = (), revision: int = 1) -> Graph:
    return Graph(
        revision=revision,
        broker_pid=1,
        nodes=(TALKER, LISTENER, TOOL),
        publishers=tuple(one for one in ends if one.kind == "publisher"),
        subscriptions=tuple(one for one in ends if one.kind == "subscription"),
        matches=matches,
    )


def count(one: GraphEndpoint, **counters: Any) -> GraphEndpoint:
    return replace(one, statistics=EndpointStatistics(**counters))


PUBLISHER = endpoint(11, "publisher", TALKER)
SUBSCRIPTION = endpoint(12, "subscription", LISTENER)
MATCHES = (GraphMatch(11, 12, "shm"),)


def test_a_topic_at_the_first_look() -> None:
    model = Model()
    assert model.take(graph(PUBLISHER, SUBSCRIPTION, matches=MATCHES), S)
    (row,) = model.topics()
    assert (row.topic, row.types, row.publishers, row.subscriptions) == (
        "/chatter",
        ("std_msgs/msg/String",),
        1,
        1,
    )
    assert (row.hz, row.bytes_per_s, row.lost, row.why, row.mismatches) == (None, None, 0, "", 0)
    assert (row.routes, row.depth, row.is_hidden) == (("shm",), 7, False)
    assert model.pairs("/chatter") == (Pair(11, 12, "shm"),)


def test_rates_queues_and_losses() -> None:
    model = Model()
    for turn in range(4):
        lost = {"replaced": 5 * turn, "expired": turn // 3} if turn else {}
        model.take(
            graph(
                count(PUBLISHER, samples=100 * turn, bytes=5000 * turn, at_ns=(turn + 1) * S),
                count(
                    SUBSCRIPTION, samples=95 * turn, bytes=4750 * turn, at_ns=(turn + 1) * S,
                    queued=3, dropped=lost,
                ),
                matches=MATCHES,
            ),
            (turn + 1) * S,
        )  # fmt: skip
    (row,) = model.topics()
    assert (row.hz, row.bytes_per_s, row.queued, row.depth) == (100.0, 5000.0, 3, 7)
    assert (row.lost, row.why, row.dropped) == (16, "replaced", {"replaced": 15, "expired": 1})
    assert row.lost_per_s == 16 / 3
    assert row.history == (100.0, 100.0, 100.0)
    publisher, subscription = model.endpoints("/chatter")
    assert (publisher.kind, publisher.node, publisher.pid, publisher.hz) == (
        "publisher",
        "/talker",
        10,
        100.0,
    )
    assert (subscription.node, subscription.messages, subscription.hz) == ("/ns/listener", 285, 95.0)
    assert (subscription.lost, subscription.queued, subscription.depth) == (16, 3, 7)
    assert subscription.routes == ("shm",)
    sums = model.sums([row])
    assert (sums.nodes, sums.topics, sums.hz, sums.bytes_per_s, sums.lost) == (2, 1, 100.0, 5000.0, 16)


def test_losses_of_long_ago_are_not_of_now() -> None:
    model = Model()
    for turn in range(10):
        subscription = count(SUBSCRIPTION, dropped={"replaced": min(turn, 2) * 6})
        model.take(graph(PUBLISHER, subscription, matches=MATCHES), (turn + 1) * S)
        (row,) = model.topics()
        assert (row.lost_per_s > 0) == (1 <= turn <= 4), turn
    assert row.lost == 12


def lost(count_: int, at_ns: int = S, **others: Any) -> GraphEndpoint:
    return count(SUBSCRIPTION, dropped={"replaced": count_} if count_ else {}, at_ns=at_ns, **others)


def test_losses_survive_a_restart_of_busd() -> None:
    """The listener lives on. busd learns its figures again after a moment."""
    model = Model()
    model.take(graph(PUBLISHER, lost(2), matches=MATCHES), 10 * S)
    model.take(graph(PUBLISHER, lost(7), matches=MATCHES), 11 * S)
    model.take(graph(revision=2), 12 * S)
    assert model.topics() == []
    model.take(graph(PUBLISHER, lost(0, at_ns=0), matches=MATCHES, revision=3), 13 * S)
    (row,) = model.topics()
    assert (row.lost, row.why, row.lost_in_all) == (7, "replaced", 7)
    assert row.lost_history[-4:] == (0, 5, 0, 0)
    (subscription,) = [one for one in model.endpoints("/chatter") if one.kind == "subscription"]
    assert subscription.dropped == {"replaced": 7}
    assert subscription.lost_history == row.lost_history
    model.take(graph(PUBLISHER, lost(7), matches=MATCHES, revision=3), 14 * S)
    (row,) = model.topics()
    assert (row.lost, row.lost_per_s) == (7, 0.0), "what busd learned again was not lost again"
    model.take(graph(PUBLISHER, lost(9), matches=MATCHES, revision=3), 15 * S)
    timeline = model.losses("/chatter")
    assert timeline is not None
    assert [(slot.at_s, slot.count) for slot in timeline.slots()] == [(11, 5), (15, 2)]


def test_losses_of_a_subscription_that_has_left_stay_in_its_topic() -> None:
    model = Model()
    model.take(graph(PUBLISHER, lost(0), matches=MATCHES), 10 * S)
    model.take(graph(PUBLISHER, lost(7), matches=MATCHES), 11 * S)
    model.take(graph(PUBLISHER, revision=2), 12 * S)
    (row,) = model.topics()
    assert (row.lost, row.lost_in_all, row.lost_history[-2:]) == (0, 7, (7, 0))
    assert model.losses("/other") is None


def test_how_many_that_have_left_are_remembered() -> None:
    model = Model()
    for number in range(1200):
        one = replace(SUBSCRIPTION, gid=number.to_bytes(16), topic=f"/topic_{number}")
        for dropped in ({}, {"replaced": 1}):
            model.take(graph(count(one, dropped=dropped), revision=number), (10 + number) * S)
    assert len(model._left) == len(model._pasts) == 1000
    assert "/topic_1198" in model._pasts
    assert "/topic_198" not in model._pasts


def test_advice_about_the_depth() -> None:
    model = Model()
    figures = {"dropped": {"replaced": 22}, "most_missed": 22, "expected": 5000}
    for turn in (1, 2):
        publisher = count(PUBLISHER, samples=190 * turn, at_ns=turn * S)
        subscription = count(SUBSCRIPTION, samples=190 * turn, at_ns=turn * S, **figures)
        model.take(graph(publisher, subscription, matches=MATCHES), turn * S)
        assert [one.advice for one in model.endpoints("/chatter")] == [
            "",
            {
                1: "depth 7 was once too small by 22 messages: depth 29",
                2: "depth 7 at 190 Hz holds 37 ms; the longest stall was 153 ms: depth 29",
            }[turn],
        ]


def test_what_does_not_match_and_why() -> None:
    reliable = endpoint(13, "subscription", LISTENER, qos=QoSProfile(reliability=Reliability.RELIABLE))
    offer = endpoint(11, "publisher", TALKER, qos=QoSProfile(reliability=Reliability.BEST_EFFORT))
    other = endpoint(14, "subscription", LISTENER, type_name="std_msgs/msg/Int32")
    model = Model()
    model.take(graph(offer, reliable, other), S)
    (row,) = model.topics()
    assert row.mismatches == 2
    assert row.types == ("std_msgs/msg/Int32", "std_msgs/msg/String")
    one, two = model.pairs("/chatter")
    assert (one.publisher, one.subscription, one.route) == (11, 13, "")
    assert one.reason == "ERROR: Best effort publisher and reliable subscription"
    assert two.reason == "the publisher has std_msgs/msg/String, the subscription std_msgs/msg/Int32"


def test_pairs_that_are_yet_to_be_matched_are_no_mismatch() -> None:
    model = Model()
    model.take(graph(PUBLISHER, SUBSCRIPTION), S)
    assert model.pairs("/chatter") == ()


def test_types_of_one_name_are_asked_for_and_asked_again() -> None:
    asked = []

    def describe(name: str, number: str) -> None:
        asked.append((name, number))

    model = Model(describe=describe)
    model.take(graph(PUBLISHER, endpoint(12, "subscription", LISTENER, type_hash="g")), S)
    assert [pair.reason for pair in model.pairs("/chatter")] == [
        "both call it std_msgs/msg/String, but their definitions differ"
    ]
    model.pairs("/chatter")
    assert asked == [("std_msgs/msg/String", "h"), ("std_msgs/msg/String", "g")]
    model.forget_pairs()
    model.pairs("/chatter")
    assert len(asked) == 4


def test_a_crowd_has_its_matches_and_some_of_the_others() -> None:
    many = [endpoint(number, "publisher", TALKER) for number in range(100, 150)]
    wrong = [
        endpoint(number, "subscription", LISTENER, type_name="std_msgs/msg/Int32")
        for number in range(200, 250)
    ]
    model = Model()
    model.take(graph(*many, *wrong), S)
    assert len(model.pairs("/chatter")) == 1000


def test_those_who_look_are_left_out() -> None:
    mine = endpoint(13, "subscription", TOOL)
    model = Model(own=[30])
    model.take(graph(PUBLISHER, mine, matches=(GraphMatch(11, 13, "shm"),)), S)
    (row,) = model.topics()
    assert (row.subscriptions, row.publishers) == (0, 1)
    assert model.pairs("/chatter") == ()
    others = Model()
    others.take(graph(PUBLISHER, mine), S)
    assert others.topics()[0].subscriptions == 1
    assert [row.is_hidden for row in others.endpoints("/chatter")] == [False, True]


def test_hidden_topics_on_request() -> None:
    model = Model()
    model.take(graph(PUBLISHER, endpoint(13, "publisher", TALKER, "/add/_request")), S)
    assert [row.topic for row in model.topics()] == ["/chatter"]
    assert [row.topic for row in model.topics(hidden=True)] == ["/add/_request", "/chatter"]


def test_news_is_what_has_another_revision_or_is_of_another_busd() -> None:
    model = Model()
    here = graph(PUBLISHER)
    assert model.take(here, S)
    assert not model.take(here, 2 * S)
    assert model.take(graph(PUBLISHER, SUBSCRIPTION, matches=MATCHES, revision=2), 3 * S)
    assert model.take(replace(here, revision=2, broker_pid=2), 4 * S)


def test_who_keeps_all_has_no_depth() -> None:
    model = Model()
    model.take(graph(endpoint(12, "subscription", LISTENER, qos=QoSProfile(history=History.KEEP_ALL))), S)
    assert model.endpoints("/chatter")[0].depth is None
    assert model.topic("/chatter").depth is None
    assert model.topic("/nothing") is None


def test_after_a_restart_of_busd_counting_goes_on() -> None:
    """After the restart, endpoints have other ids and the same gids."""
    model = Model()
    for turn, revision in enumerate((9, 9, 1), start=1):
        here = replace(PUBLISHER, id=11 + (revision == 1))
        model.take(graph(count(here, samples=10 * turn, at_ns=turn * S), revision=revision), turn * S)
    assert model.topic("/chatter").hz == 10.0


def test_ages_of_what_was_taken_of_late() -> None:
    model = Model()
    other = endpoint(13, "subscription", LISTENER)
    told = {"age_sum_ns": 30_000_000, "age_max_ns": 20_000_000}
    model.take(
        graph(
            PUBLISHER,
            count(SUBSCRIPTION, at_ns=S, age_count=2, **told),
            count(other, at_ns=S, age_count=1, age_sum_ns=60_000_000, age_max_ns=60_000_000),
        ),
        S,
    )
    (row,) = model.topics()
    assert row.age == Ages(0.03, 0.06)
    assert [one.age for one in model.endpoints("/chatter")] == [None, Ages(0.015, 0.02), Ages(0.06, 0.06)]
    for seconds, age in ((2, Ages(0.015, 0.02)), (4, Ages(0.015, 0.02)), (5, None)):
        model.take(graph(PUBLISHER, count(SUBSCRIPTION, at_ns=seconds * S)), seconds * S)
        assert model.topic("/chatter").age == age, seconds


def test_nodes() -> None:
    model = Model()
    reliable = endpoint(14, "subscription", TALKER, "/b", qos=QoSProfile(7))
    careless = endpoint(15, "publisher", LISTENER, "/b", qos=QoSProfile(7, reliability="best_effort"))
    for seconds in (1, 2):
        model.take(
            graph(
                count(PUBLISHER, samples=10 * seconds, at_ns=seconds * S),
                count(SUBSCRIPTION, queued=3, dropped={"replaced": 4}),
                reliable,
                careless,
                endpoint(16, "subscription", TOOL),
                matches=MATCHES,
            ),
            seconds * S,
        )
    listener, talker = model.nodes()
    assert (listener.node, listener.pid, listener.publishers, listener.subscriptions) == (
        "/ns/listener", 20, 1, 1,
    )  # fmt: skip
    assert (listener.queued, listener.depth, listener.lost, listener.why) == (3, 7, 4, "replaced")
    assert (listener.mismatches, listener.routes, listener.hz) == (1, ("shm",), None)
    assert (talker.hz, talker.routes, talker.mismatches, talker.lost) == (10.0, ("shm",), 1, 0)
    assert talker.history == (10.0,)
    assert [one.topic for one in model.endpoints_of_node(talker.id)] == ["/chatter", "/b"]
    assert [one.node for one in model.nodes(hidden=True)] == ["/_bus_web_30", "/ns/listener", "/talker"]
    assert model.endpoints_of_node(99) == []
