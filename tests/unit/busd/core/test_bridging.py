"""busd.core.bridging, and other rules for bridges: origins, mirrors and taps."""

from itertools import product

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import NUMBER, UID, Node, Process, World, refused
from bus.base.ids import EndpointId
from bus.qos import QoSProfile
from bus.wire import messages as m
from rows import for_each

ALL = QoSProfile(history="keep_all")
FAR = m.Origin(bridge="zenoh", bus="far")
GID = b"g" * 16


def nodes() -> tuple[Node, Node, Process]:
    """A local node, a bridge's mirror of a node on another bus, and the bridge."""
    world = World()
    bridge = world.process("bridge")
    return world.process("program").node("local"), bridge.node("mirror", origin=FAR), bridge


def is_matched(publisher: Publisher, subscription: Subscription) -> bool:
    """True if both ends were told of the match. Both must have been told the same."""
    told = [[one.other for one in end.got(m.Matched)] for end in (publisher, subscription)]
    assert (subscription.id in told[0]) is (publisher.id in told[1])
    return subscription.id in told[0]


class TestOrigins:
    def test_the_graph_shows_them(self) -> None:
        local, mirror, _ = nodes()
        shown = {one.id: one.origin for one in local.process.graph().nodes}
        assert shown == {local.id: None, mirror.id: FAR}

    def test_observers_hear_of_them(self) -> None:
        local, _, bridge = nodes()
        local.process.request(m.Observe(request=0), m.GraphSnapshot)
        via = m.Origin(bridge="zenoh", bus="near", via=("far", "middle"))
        made = bridge.node("other", origin=via)
        (change,) = local.process.got(m.GraphChanged)
        assert [(one.id, one.origin) for one in change.nodes_added] == [(made.id, via)]
        assert via.buses == {"near", "far", "middle"}

    def test_one_that_can_not_be_printed(self) -> None:
        _, _, bridge = nodes()
        bridge.tell(m.CreateNode(request=1, name="n", origin=m.Origin(bridge="zenoh", bus="a\x1b")))
        assert bridge.cut_reason == "origin 'a\\x1b', which can't be printed"

    @for_each(
        ("one", "other", "expected"),
        [
            (None, None, True),
            (None, FAR, True),
            (FAR, None, True),
            (FAR, FAR, False),
            (FAR, m.Origin(bridge="ros2", bus="domain 0"), True),
            (FAR, m.Origin(bridge="ros2", bus="far"), False),
            (FAR, m.Origin(bridge="zenoh", bus="middle", via=("far",)), False),
            (
                m.Origin(bridge="zenoh", bus="a", via=("b", "c")),
                m.Origin("zenoh", "d", via=("c", "e")),
                False,
            ),
            (m.Origin(bridge="zenoh", bus="a", via=("b",)), m.Origin("zenoh", "c", via=("d",)), True),
        ],
    )
    def test_what_came_from_a_bus_does_not_go_back(
        self, one: m.Origin | None, other: m.Origin | None, expected: bool
    ) -> None:
        for is_publisher_first, (first, second) in product((True, False), ((one, other), (other, one))):
            world = World()
            talker = world.process().node("talker", origin=first)
            listener = world.process().node("listener", origin=second)
            if is_publisher_first:
                publisher = talker.publisher("/topic")
                subscription = listener.subscription("/topic")
            else:
                subscription = listener.subscription("/topic")
                publisher = talker.publisher("/topic")
            publisher.publish("one")
            assert is_matched(publisher, subscription) is expected
            assert subscription.payloads == ["one"] * expected
            assert not publisher.got(m.Incompatible) and not subscription.got(m.Incompatible)
            assert world.notes == []

    def test_local_only(self) -> None:
        local, mirror, bridge = nodes()
        near, far = local.publisher("/topic"), mirror.publisher("/topic")
        subscription = bridge.subscription("/topic", local_only=True)
        near.publish("near")
        far.publish("far")
        assert subscription.payloads == ["near"]
        assert is_matched(near, subscription) and not is_matched(far, subscription)
        assert not far.got(m.Incompatible)


class TestNames:
    """A node of another bus may have the name of a local node."""

    def test_who_lives_here_is_told_and_a_mirror_is_not(self) -> None:
        world = World()
        local, bridge = (world.process(one, capabilities=("namesakes",)) for one in ("program", "bus"))
        local.node("talker")
        bridge.node("talker", origin=m.Origin("zenoh", "hub", via=("robot-1",)))
        (told,) = local.got(m.Namesake)
        assert told.program == "bus, which has brought it from robot-1"
        assert not bridge.got(m.Namesake)

    def test_two_of_other_buses_are_nobody_s_matter(self) -> None:
        world = World()
        bridge = world.process("bus", capabilities=("namesakes",))
        bridge.node("talker", origin=FAR)
        bridge.node("talker", origin=m.Origin("zenoh", "further"))
        assert not bridge.got(m.Namesake) and world.notes == []


class TestGids:
    def test_the_graph_shows_the_other_s_and_matches_have_both(self) -> None:
        local, mirror, _ = nodes()
        subscription = local.subscription("/topic")
        publisher = mirror.publisher("/topic", stands_for=GID)
        (record,) = [one for one in local.process.graph().endpoints if one.id == publisher.id]
        assert record.gid == GID
        (matched,) = subscription.got(m.Matched)
        assert (matched.gid, matched.stands_for) == (publisher.gid, GID)
        (matched,) = publisher.got(m.Matched)
        assert (matched.gid, matched.stands_for) == (subscription.gid, b"")

    @pytest.mark.parametrize("is_publisher", [True, False])
    def test_the_same_by_two_ways_is_refused(self, is_publisher: bool) -> None:
        local, mirror, _ = nodes()
        another = local.process.world.process("another bridge")
        other = another.node("again", origin=m.Origin("ros2", "domain 0"))
        first: Publisher | Subscription
        if is_publisher:
            first = mirror.publisher("/topic", stands_for=GID)
            answer = refused(other.publisher, "/topic", stands_for=GID)
        else:
            first = mirror.subscription("/topic", gid=GID)
            answer = refused(other.subscription, "/topic", gid=GID)
        assert answer.again, "the first may go"
        kind = "publisher" if is_publisher else "subscription"
        assert answer.text == (
            f"gid {GID.hex()} is on this bus already: {kind} of /mirror on '/topic', brought from far by "
            "bridge zenoh"
        )
        refused(mirror.publisher, "/other", stands_for=GID)
        assert len(local.process.graph().endpoints) == 1
        first.destroy()
        if is_publisher:
            other.publisher("/topic", stands_for=GID)
        else:
            other.subscription("/topic", gid=GID)

    def test_one_that_lives_here_is_no_mirror(self) -> None:
        local, mirror, _ = nodes()
        local.publisher("/topic", gid=GID)
        answer = refused(mirror.publisher, "/topic", stands_for=GID)
        assert answer.text == f"gid {GID.hex()} is on this bus already: publisher of /local on '/topic'"

    def test_what_lives_here_is_never_refused_for_a_mirror(self) -> None:
        local, mirror, _ = nodes()
        mirror.subscription("/topic", gid=GID)
        local.subscription("/topic", gid=GID)

    def test_a_bridge_that_is_back_need_not_wait_for_the_end_of_what_it_had(self) -> None:
        world = World()
        bridge = world.process("bridge")
        heard = [world.process().subscription("/topic") for _ in range(8)]
        bridge.node("mirror", origin=FAR).publisher("/topic", stands_for=GID)
        again = world.process("bridge").node("mirror", origin=FAR)
        made: list[Publisher] = []

        def come_back() -> None:
            world.between = lambda: None
            assert world.broker.tasks.unfinished
            made.append(again.publisher("/topic", stands_for=GID))

        world.budget, world.between = 1, come_back
        bridge.die()
        world.budget = 1 << 62
        made[0].publish("one")
        assert [one.payloads for one in heard] == [["one"]] * 8
        records = world.whole_graph()
        assert [one.gid for one in records.endpoints if one.kind == "publisher"] == [GID]
        assert len(records.matches) == 8

    def test_a_gid_of_another_length(self) -> None:
        _, mirror, bridge = nodes()
        bridge.declare_type(NUMBER)
        message = m.CreatePublisher(
            request=1,
            node=mirror.id,
            topic="/topic",
            type_name=NUMBER[0],
            type_hash=NUMBER[1],
            qos=QoSProfile(),
            gid=GID,
            stands_for=b"short",
        )
        bridge.tell(message)
        assert bridge.cut_reason == "gid of 5 bytes, a gid has 16"

    def test_one_that_is_made_anew_is_another_publisher_to_those_that_knew_the_first(self) -> None:
        world = World()
        subscription = world.process().subscription("/topic")
        for text in ("one", "two"):
            bridge = world.process("bridge")
            bridge.node("mirror", origin=FAR).publisher("/topic", stands_for=GID).publish(text)
            bridge.die()
        assert subscription.payloads == ["one", "two"]
        assert [one.seq for one in subscription.samples] == [1, 1]
        assert subscription.statistics().expected == 2


class TestMirrors:
    def test_it_is_matched_and_shown_but_gets_nothing(self) -> None:
        for shares in (True, False):
            world = World()
            publisher = world.process(shares=shares).publisher("/topic")
            node = world.process("bridge", shares=shares).node("mirror", origin=FAR)
            mirror = node.subscription("/topic", gid=GID, role="mirror")
            for end in (publisher, mirror):
                (matched,) = end.got(m.Matched)
                assert (matched.route, matched.descriptors) == ("bridge", 0)
            publisher.publish("one")
            assert mirror.payloads == []
            graph = world.whole_graph(statistics=True)
            assert [one.route for one in graph.matches] == ["bridge"]
            (record,) = [one for one in graph.endpoints if one.kind == "subscription"]
            assert record.gid == GID
            assert mirror.statistics().expected == 0
            mirror.destroy()
            assert publisher.got(m.Unmatched)[0].other == mirror.id

    def test_nobody_waits_for_it(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic", ALL)
        bridge = world.process("bridge")
        bridge.node("mirror", origin=FAR).subscription("/topic", ALL, role="mirror")
        entity = world.broker.graph.publishers[EndpointId(publisher.id)]
        publisher.publish("one")
        assert not entity.awaited
        world.advance(60)  # the bridge is silent; busd would tell a publisher only if it waited
        bridge.tell(m.Ping())
        world.advance(1)
        assert not entity.awaited and not publisher.got(m.Silence)

    def test_both_are_told_why_there_is_no_match(self) -> None:
        local, mirror, _ = nodes()
        publisher = local.publisher("/topic", QoSProfile(reliability="best_effort"))
        subscription = mirror.subscription("/topic", role="mirror")
        assert [one.policy for one in publisher.got(m.Incompatible)] == ["RELIABILITY"]
        assert [one.policy for one in subscription.got(m.Incompatible)] == ["RELIABILITY"]

    def test_it_gets_no_history(self) -> None:
        local, mirror, _ = nodes()
        latched = QoSProfile(durability="transient_local")
        publisher = local.publisher("/topic", latched)
        publisher.publish("one")
        subscription = mirror.subscription("/topic", latched, role="mirror")
        assert subscription.payloads == [] and is_matched(publisher, subscription)

    def test_what_it_would_have_missed_is_not_kept(self) -> None:
        local, mirror, bridge = nodes()
        publisher = local.publisher("/topic")
        mirror.subscription("/topic", role="mirror")
        publisher.publish("one")
        bridge.die()
        assert local.process.world.broker._absentees.record() == m.AbsentRecord()


class TestTaps:
    @for_each(
        ("offered", "requested", "expected"),
        [
            (ALL, ALL, True),
            (ALL, QoSProfile(reliability="best_effort"), False),
            (QoSProfile(), ALL, False),
            (QoSProfile(), QoSProfile(reliability="best_effort"), True),
            (QoSProfile(history="keep_all", reliability="best_effort"), ALL, False),
            (QoSProfile(reliability="best_effort"), QoSProfile(), False),
        ],
    )
    def test_each_publisher_has_one(self, offered: QoSProfile, requested: QoSProfile, expected: bool) -> None:
        local, _, bridge = nodes()
        publisher = local.publisher("/topic", offered)
        tap = bridge.subscription("/topic", requested, role="tap", local_only=True)
        publisher.publish("one")
        assert is_matched(publisher, tap) is expected
        assert tap.payloads == ["one"] * expected
        assert not publisher.got(m.Incompatible) and not tap.got(m.Incompatible)
        assert local.process.world.notes == []

    def test_of_another_type_nobody_is_told(self) -> None:
        local, _, bridge = nodes()
        publisher = local.publisher("/topic", kind=NUMBER)
        tap = bridge.subscription("/topic", role="tap")
        assert not is_matched(publisher, tap)
        assert not publisher.got(m.Incompatible) and not tap.got(m.Incompatible)

    def test_the_graph_and_the_publisher_know_it_as_such(self) -> None:
        local, _, bridge = nodes()
        publisher = local.publisher("/topic")
        tap = bridge.subscription("/topic", role="tap")
        assert [one.is_tap for one in publisher.got(m.Matched)] == [True]
        assert [one.is_tap for one in tap.got(m.Matched)] == [False]
        assert [one.kind for one in local.process.graph().endpoints if one.id == tap.id] == ["tap"]

    def test_it_learns_of_a_publisher_after_the_mirror(self) -> None:
        """It may find samples in the ring at once, and the bridge drops them without the mirror's match."""
        local, node, bridge = nodes()
        tap = bridge.subscription("/topic", role="tap")
        mirror = node.subscription("/topic", gid=GID, role="mirror")
        local.publisher("/topic")
        assert [one.endpoint for one in bridge.got(m.Matched)] == [mirror.id, tap.id]

    def test_a_lossless_publisher_waits_for_it(self) -> None:
        local, _, bridge = nodes()
        publisher = local.publisher("/topic", ALL)
        tap = bridge.subscription("/topic", ALL, role="tap", local_only=True)
        publisher.publish("one")
        assert not publisher.got(m.Credit)
        tap.ack(publisher, 1)
        assert [one.seq for one in publisher.got(m.Credit)] == [1]


def test_access_rules_hold_for_mirrors() -> None:
    world = World()
    guest = world.process("bridge", uid=UID + 1).node("mirror", origin=FAR)
    answer = refused(guest.publisher, "/topic", stands_for=GID)
    assert answer.denied
    assert not world.whole_graph().endpoints
    assert EndpointId(1) not in world.broker.graph.publishers
