"""busd.core.matching: the endpoints that match, and the messages to both sides."""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import NUMBER, SECOND, TEXT, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from rows import for_each

Q = QoSProfile
MANUAL = "manual_by_topic"

# offered, requested, the last policy that differs, the text with all reasons
INCOMPATIBLE = [
    (
        Q(reliability="best_effort"),
        Q(),
        "RELIABILITY",
        "ERROR: Best effort publisher and reliable subscription;",
    ),
    (
        Q(),
        Q(durability="transient_local"),
        "DURABILITY",
        "ERROR: Volatile publisher and transient local subscription;",
    ),
    (Q(), Q(deadline=1.0), "DEADLINE", "ERROR: Subscription has a deadline, but publisher does not;"),
    (
        Q(deadline=2.0),
        Q(deadline=1.0),
        "DEADLINE",
        "ERROR: Subscription deadline is less than publisher deadline;",
    ),
    (
        Q(),
        Q(liveliness=MANUAL),
        "LIVELINESS",
        "ERROR: Publisher's liveliness is automatic and subscription's is manual by topic;",
    ),
    (
        Q(),
        Q(liveliness_lease_duration=1.0),
        "LIVELINESS_LEASE_DURATION",
        "ERROR: Subscription has a liveliness lease duration, but publisher does not;",
    ),
    (
        Q(liveliness_lease_duration=2.0),
        Q(liveliness_lease_duration=1.0),
        "LIVELINESS_LEASE_DURATION",
        "ERROR: Subscription liveliness lease duration is less than publisher;",
    ),
    (
        Q(reliability="best_effort", deadline=2.0),
        Q(durability="transient_local", deadline=1.0),
        "DEADLINE",
        "ERROR: Best effort publisher and reliable subscription;"
        "ERROR: Volatile publisher and transient local subscription;"
        "ERROR: Subscription deadline is less than publisher deadline;",
    ),
]

COMPATIBLE = [
    (Q(), Q()),
    (Q(), Q(reliability="best_effort")),
    (Q(durability="transient_local"), Q()),
    (Q(durability="transient_local"), Q(durability="transient_local")),
    (Q(deadline=1.0), Q(deadline=1.0)),
    (Q(deadline=1.0), Q()),
    (Q(liveliness=MANUAL), Q()),
    (Q(liveliness_lease_duration=1.0), Q(liveliness_lease_duration=2.0)),
    (Q(depth=1, lifespan=1.0), Q(history="keep_all")),
    (Q(history="keep_all"), Q(depth=1, lifespan=1.0)),
]


class Pair:
    """A talker with a publisher, and a listener with a subscription, made in either order."""

    def __init__(self, offered: QoSProfile, requested: QoSProfile, *, publisher_first: bool) -> None:
        self.world = World()
        talker, listener = self.world.process(), self.world.process()
        self.talker = talker.node("talker", "/a")
        self.listener = listener.node("listener")
        if publisher_first:
            self.publisher = self.talker.publisher("/topic", offered)
        self.subscription = self.listener.subscription("/topic", requested)
        if not publisher_first:
            self.publisher = self.talker.publisher("/topic", offered)


@pytest.mark.parametrize("publisher_first", [True, False])
class TestQoS:
    @pytest.mark.parametrize(("offered", "requested", "policy", "text"), INCOMPATIBLE)
    def test_incompatible(
        self, offered: QoSProfile, requested: QoSProfile, policy: str, text: str, publisher_first: bool
    ) -> None:
        pair = Pair(offered, requested, publisher_first=publisher_first)
        expected = {"topic": "/topic", "policy": policy, "text": text}
        assert pair.publisher.got(m.Incompatible) == [
            m.Incompatible(endpoint=pair.publisher.id, node="/listener", **expected)
        ]
        assert pair.subscription.got(m.Incompatible) == [
            m.Incompatible(endpoint=pair.subscription.id, node="/a/talker", **expected)
        ]
        pair.publisher.publish("unheard")
        assert pair.subscription.payloads == []
        assert not pair.publisher.got(m.Matched)
        note = "no match on '/topic': publisher /a/talker and subscription /listener: " + text
        assert note in pair.world.notes

    @pytest.mark.parametrize(("offered", "requested"), COMPATIBLE)
    def test_compatible(self, offered: QoSProfile, requested: QoSProfile, publisher_first: bool) -> None:
        pair = Pair(offered, requested, publisher_first=publisher_first)
        publisher, subscription = pair.publisher, pair.subscription
        assert publisher.got(m.Matched) == [
            m.Matched(
                endpoint=publisher.id,
                other=subscription.id,
                node="/listener",
                gid=subscription.gid,
                qos=requested,
                at_ns=pair.world.now_ns,
            )
        ]
        assert subscription.got(m.Matched) == [
            m.Matched(
                endpoint=subscription.id,
                other=publisher.id,
                node="/a/talker",
                gid=publisher.gid,
                qos=offered,
                at_ns=pair.world.now_ns,
            )
        ]
        assert not publisher.got(m.Incompatible)
        publisher.publish("heard")
        assert subscription.payloads == ["heard"]


class TestTypes:
    def pair(self, offered: tuple[str, str], requested: tuple[str, str]) -> tuple[Publisher, Subscription]:
        world = World()
        publisher = world.process().node("talker").publisher("/topic", kind=offered)
        return publisher, world.process().node("listener").subscription("/topic", kind=requested)

    def test_two_types(self) -> None:
        publisher, subscription = self.pair(TEXT, NUMBER)
        text = "the publisher has test_msgs/msg/Text, the subscription test_msgs/msg/Number"
        for endpoint, node in ((publisher, "/listener"), (subscription, "/talker")):
            (told,) = endpoint.got(m.Incompatible)
            assert (told.policy, told.text, told.node) == ("TYPE", text, node)
        publisher.publish("unheard")
        assert subscription.payloads == []

    def test_two_definitions_of_one_name(self) -> None:
        _, subscription = self.pair(TEXT, (TEXT[0], "another"))
        (told,) = subscription.got(m.Incompatible)
        assert told.policy == "TYPE"
        assert told.text == (
            "both call it test_msgs/msg/Text, but their definitions differ (hash-1 and another)"
        )

    def test_the_type_counts_before_the_qos(self) -> None:
        world = World()
        listener = world.process()
        world.process().publisher("/topic", Q(reliability="best_effort"), kind=NUMBER)
        (told,) = listener.subscription("/topic").got(m.Incompatible)
        assert told.policy == "TYPE"


class TestOthersAreUnaffected:
    def test_one_incompatible_subscription(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic", Q(reliability="best_effort"))
        strict = world.process().subscription("/topic")
        easy = world.process().subscription("/topic", Q(reliability="best_effort"))
        publisher.publish("x")
        assert (strict.payloads, easy.payloads) == ([], ["x"])

    def test_other_topics(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        other = world.process().subscription("/topic/sub")
        publisher.publish("x")
        assert other.payloads == []
        assert not other.got(m.Matched)

    def test_a_process_that_hears_itself(self) -> None:
        process = World().process()
        publisher, subscription = process.publisher("/topic"), process.subscription("/topic")
        publisher.publish("x")
        assert subscription.payloads == ["x"]


class TestUnmatching:
    def world(self) -> tuple[Process, Process, Publisher, Subscription]:
        world = World()
        talker, listener = world.process(), world.process()
        return talker, listener, talker.publisher("/topic"), listener.subscription("/topic")

    @for_each("how", ["endpoint", "node", "process"])
    def test_the_publisher_goes(self, how: str) -> None:
        talker, _, publisher, subscription = self.world()
        match how:
            case "endpoint":
                publisher.destroy()
            case "node":
                talker._own_node().destroy()
            case "process":
                talker.die()
        told = m.Unmatched(endpoint=subscription.id, other=publisher.id, lost=how == "process")
        assert subscription.got(m.Unmatched) == [told]
        assert len(publisher.got(m.Unmatched)) == (how != "process")

    @for_each("how", ["endpoint", "node", "process"])
    def test_the_subscription_goes(self, how: str) -> None:
        _, listener, publisher, subscription = self.world()
        match how:
            case "endpoint":
                subscription.destroy()
            case "node":
                listener._own_node().destroy()
            case "process":
                listener.die()
        gone = m.Unmatched(endpoint=publisher.id, other=subscription.id, lost=how == "process")
        assert publisher.got(m.Unmatched) == [gone]
        publisher.publish("unheard")
        assert subscription.payloads == []

    def test_what_waits_is_still_delivered(self) -> None:
        talker, listener, publisher, subscription = self.world()
        listener.is_blocked = True
        publisher.publish("a", "b")
        talker.die()
        listener.unblock()
        assert subscription.payloads == ["a", "b"]

    def test_a_subscription_hears_what_was_routed_for_it(self) -> None:
        world = World()
        talker = world.process(shares=True)
        publisher = talker.publisher("/topic")
        by_socket = world.process().subscription("/topic")
        by_ring = world.process(shares=True).subscription("/topic")
        publisher.publish("a", "b")
        talker.die()
        assert [told.last_seq for told in by_socket.got(m.Unmatched)] == [2]
        assert [told.last_seq for told in by_ring.got(m.Unmatched)] == [0]


class TestClocks:
    """Processes in other time namespaces receive times of their own clocks."""

    def test_when_it_was_matched(self) -> None:
        world = World()
        ahead, behind = world.process(clock_ns=5 * SECOND), world.process(clock_ns=-3 * SECOND)
        subscription, publisher = behind.subscription("/topic"), ahead.publisher("/topic")
        (told,) = subscription.got(m.Matched)
        assert (told.at_ns, told.clock_ns) == (world.now_ns - 3 * SECOND, 8 * SECOND)
        (told,) = publisher.got(m.Matched)
        assert (told.at_ns, told.clock_ns) == (world.now_ns + 5 * SECOND, -8 * SECOND)

    def test_a_time_that_can_not_be_is_none_below_zero(self) -> None:
        world = World()
        subscription = world.process(clock_ns=-(1 << 60)).subscription("/topic")
        world.process().publisher("/topic")
        assert [one.at_ns for one in subscription.got(m.Matched)] == [0]

    def test_a_lifespan_is_by_the_clock_that_stamps(self) -> None:
        world = World()
        listener, talker = world.process(), world.process(clock_ns=-100 * SECOND)
        subscription = listener.subscription("/topic")
        publisher = talker.publisher("/topic", QoSProfile(lifespan=5.0))
        listener.is_blocked = True
        publisher.publish("old", stamp_ns=world.now_ns - 100 * SECOND)
        world.advance(4)
        publisher.publish("new", stamp_ns=world.now_ns - 100 * SECOND)
        world.advance(2)
        listener.unblock()
        assert subscription.payloads == ["new"]
