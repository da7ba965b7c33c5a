"""Publishers and subscriptions of bridges, and the endpoints that match them."""

from typing import Any

import pytest

from bus import shm
from bus.errors import ConfigurationError
from bus.events import MatchedChange, PublisherEvents
from bus.graph import graph_of
from bus.link.graph_mirror import GraphMirror
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.wire import messages as m
from client_world import SUPPORT, TOPIC, Client, ClientWorld

LOSSLESS = QoSProfile(history="keep_all")
FAR = m.Origin("zenoh", "far")
GID = b"g" * 16
PADDING = "x" * 200_000

by_shm = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())


class Stage:
    """A talker and a bridge, which has a mirror of another bus's node."""

    def __init__(self, *, shares: bool) -> None:
        self.world = ClientWorld()
        self.talker = self.world.client(shares=shares)
        self.bridge = self.world.client(shares=shares, origin=FAR)
        self.changes: list[MatchedChange] = []

    def publisher(self, qos: QoSProfile) -> Publisher[Any]:
        made = self.talker.publisher(qos)
        made._core.events = PublisherEvents(matched=self.changes.append)
        self.world.settle()
        return made

    def report(self) -> dict[bytes, m.EndpointStatistics]:
        """The statistics in the graph, by gid."""
        self.world.advance(1)
        found = self.world.whole_graph(statistics=True).endpoints
        return {one.gid: one.statistics for one in found if one.statistics is not None}


@pytest.fixture(params=["shm", "socket"])
def shares(request: pytest.FixtureRequest) -> bool:
    """True if the clients share memory."""
    if request.param == "shm" and not shm.is_available():
        pytest.skip("no shared memory here")
    return bool(request.param == "shm")


class TestTaps:
    def test_it_gets_messages_and_is_in_no_count(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(QoSProfile(3))
        tap = stage.bridge.subscription(QoSProfile(3, reliability="best_effort"), role="tap", local_only=True)
        stage.world.settle()
        assert stage.talker.publish(publisher, 2) == 2
        stage.world.settle()
        assert stage.bridge.take(tap) == [(1, 1), (1, 2)]
        assert tap.get_publisher_count() == 1 and [one.gid for one in tap.matches] == [publisher.gid]
        assert publisher.get_subscription_count() == publisher.statistics().subscriptions == 0
        assert publisher.matches == () and stage.changes == []
        assert "subscriptions=0" in repr(publisher)

    def test_a_lossless_publisher_waits_for_it(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(LOSSLESS)
        tap = stage.bridge.subscription(LOSSLESS, role="tap", local_only=True)
        stage.world.settle()
        taken, padding = 0, "x" * 200_000
        while stage.talker.publish(publisher, 1, padding):
            taken += 1
            stage.world.settle()
            assert taken < 2_000, "there is always room"
        assert len(stage.bridge.take(tap)) == taken
        stage.world.advance(1)
        assert stage.talker.publish(publisher, 1, padding) == 1

    def test_one_that_goes_is_forgotten(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(QoSProfile(3))
        tap = stage.bridge.subscription(QoSProfile(3), role="tap")
        stage.world.settle()
        assert len(publisher._core.matches.taps) == 1
        stage.bridge.close(tap)
        stage.world.settle()
        assert publisher._core.matches.taps == {} and stage.changes == []

    def test_nobody_who_waits_for_a_subscription_waits_for_it(self, shares: bool) -> None:
        """A caller that waits for a subscription does not wait for a tap, even if the tap's process hangs
        before it has named its slot.
        """
        stage = Stage(shares=shares)
        publisher = stage.publisher(QoSProfile(3))
        stage.bridge.is_held = True
        stage.bridge.subscription(QoSProfile(3), role="tap")
        stage.world.settle()
        assert publisher._core.count_ready() == 0
        listener = stage.world.client(shares=stage.talker.shm_context is not None)
        listener.subscription(QoSProfile(3))
        stage.world.settle()
        assert publisher._core.count_ready() == 1

    def test_the_graph_has_it_apart(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(QoSProfile(3))
        tap = stage.bridge.subscription(QoSProfile(3), role="tap")
        stage.world.settle()
        graph = graph_of(stage.world.whole_graph())
        assert [one.gid for one in graph.taps] == [tap.gid] and graph.subscriptions == ()
        (match,) = graph.matches
        assert (match.publisher, match.subscription) == (publisher._core.id, tap._core.id)
        assert [one.origin for one in graph.nodes] == [None, FAR]

    def test_watches_hear_of_it(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        mirror = GraphMirror()
        mirror.begin(stage.world.whole_graph())
        record = m.EndpointRecord(7, "tap", mirror_node(mirror), TOPIC, "a/msg/A", "h", GID, QoSProfile())
        revision = stage.world.whole_graph().revision
        mirror.change(m.GraphChanged(revision=revision + 1, endpoints_added=(record,)))
        assert mirror.graph is not None and [one.id for one in mirror.graph.taps] == [7]
        unknown = m.EndpointRecord(8, "other", record.node, TOPIC, "a/msg/A", "h", GID, QoSProfile())
        mirror.change(m.GraphChanged(revision + 2, endpoints_added=(unknown,), endpoints_removed=(7, 8)))
        assert mirror.graph.taps == mirror.graph.subscriptions == ()


def mirror_node(mirror: GraphMirror) -> int:
    assert mirror.graph is not None
    return mirror.graph.nodes[0].id


class Held(Stage):
    """Two lossless publishers, and a tap that gives the first one no more room."""

    def __init__(self, *, shares: bool) -> None:
        super().__init__(shares=shares)
        self.first, self.second = self.publisher(LOSSLESS), self.publisher(LOSSLESS)
        self.tap = self.bridge.subscription(LOSSLESS, role="tap", local_only=True)
        self.world.settle()
        self.tap.hold_back(self.first.gid)
        self.heard: list[tuple[int, int]] = []

    def fill(self, publisher: Publisher[Any]) -> int:
        """Publish until the publisher must wait, and take meanwhile. Returns the number of published
        messages.
        """
        said = 0
        while self.talker.publish(publisher, 1, PADDING):
            said += 1
            self.world.settle()
            self.take()
            assert said < 2_000, "there is always room"
        return said

    def take(self) -> list[tuple[int, int]]:
        self.world.advance(0.1)
        found = self.bridge.take(self.tap)
        self.heard += found
        return found

    def goes_on(self, said: int) -> None:
        """After the release, all messages of the first publisher arrive, and it has room again."""
        self.tap.release(self.first.gid)
        self.take()
        assert [number for who, number in self.heard if who == 1] == [*range(1, said + 1)]
        self.world.advance(1)
        assert self.talker.publish(self.first, 1, PADDING) == 1
        assert self.take() == [(1, said + 1)]
        found = self.tap.statistics()
        assert not found.dropped and found.expected == found.delivered == len(self.heard)


class TestHoldingBack:
    def test_one_publisher_waits_and_the_other_goes_on(self, shares: bool) -> None:
        stage = Held(shares=shares)
        said = stage.fill(stage.first)
        for number in range(1, 200):
            assert stage.talker.publish(stage.second, 1, PADDING) == 1
            assert stage.take() == [(2, number)]
        assert stage.talker.publish(stage.first, 1, PADDING) == 0
        assert stage.tap.statistics().queued == (said if shares else 0)
        stage.goes_on(said)

    @by_shm
    def test_nothing_of_it_is_taken_out_of_its_ring(self) -> None:
        stage = Held(shares=True)
        stage.talker.publish(stage.first, 3)
        assert stage.take() == [] and stage.tap.take_packed(1000, 500) is None
        stage.talker.publish(stage.second, 3)
        stage.world.advance(0.1)
        pack = stage.tap.take_packed(1000, 500)
        assert pack is not None and (pack.publisher_gid, pack.messages) == (stage.second.gid, 3)
        assert not pack.has_more
        stage.tap.release(stage.first.gid)
        assert stage.take() == [(1, 1), (1, 2), (1, 3)]

    def test_who_waits_for_a_message_is_woken_where_one_is_there_then(self, shares: bool) -> None:
        stage = Held(shares=shares)
        arrivals: list[int] = []
        stage.tap.set_arrival_callback(lambda: arrivals.append(len(stage.bridge.take(stage.tap))))
        stage.talker.publish(stage.first, 3)
        stage.world.settle()
        assert sum(arrivals) == (0 if shares else 3)
        stage.tap.release(stage.first.gid)
        stage.world.settle()
        assert sum(arrivals) == 3

    def test_it_is_held_back_by_the_next_busd_too(self, shares: bool) -> None:
        stage = Held(shares=shares)
        said = stage.fill(stage.first)
        stage.world.restart_broker()
        stage.world.connect_all()
        stage.world.advance(15)
        said += stage.fill(stage.first)  # the socket window starts from the beginning
        assert stage.talker.publish(stage.second, 1) == 1
        assert stage.take() == [(2, 1)]
        stage.goes_on(said)

    def test_a_publisher_that_comes_later_may_be_held_back_before(self, shares: bool) -> None:
        stage = Held(shares=shares)
        stage.tap.hold_back(GID)
        third = stage.talker.publisher(LOSSLESS, gid=GID)
        stage.world.settle()
        said = stage.fill(third)
        stage.tap.release(GID)
        stage.take()
        assert [number for _, number in stage.heard] == [*range(1, said + 1)]

    @by_shm
    def test_what_waits_in_the_ring_comes_where_the_match_goes_by_socket_then(self) -> None:
        stage = Held(shares=True)
        said = stage.fill(stage.first)
        refusal = m.RefuseRoute(endpoint=stage.tap._core.id, other=stage.first._core.id, text="a test")
        stage.bridge.send_about(stage.tap._core, refusal)
        stage.world.settle()
        said += stage.fill(stage.first)
        assert stage.talker.publish(stage.second, 1) == 1
        stage.take()
        assert stage.heard[-1] == (2, 1)
        stage.goes_on(said)

    @by_shm
    def test_what_waits_in_the_ring_comes_where_the_next_busd_shares_no_memory(self) -> None:
        stage = Held(shares=True)
        stage.talker.publish(stage.first, 3)
        assert stage.take() == []
        stage.world.restart_broker()
        context, stage.bridge.shm_context = stage.bridge.shm_context, None
        stage.world.connect_all()
        stage.bridge.shm_context = context
        stage.world.advance(15)
        assert [match.route for match in stage.tap.matches] == ["socket", "socket"]
        stage.goes_on(3)

    def test_what_it_has_said_last_stays_for_later(self, shares: bool) -> None:
        stage = Held(shares=shares)
        stage.talker.publish(stage.first, 3)
        stage.world.settle()
        stage.talker.close(stage.first)
        assert stage.take() == ([] if shares else [(1, 1), (1, 2), (1, 3)])
        stage.tap.release(stage.first.gid)
        stage.take()
        assert stage.heard == [(1, 1), (1, 2), (1, 3)]

    def test_none_is_known_once_it_is_closed(self, shares: bool) -> None:
        stage = Held(shares=shares)
        stage.fill(stage.first)
        stage.bridge.close(stage.tap)
        stage.tap.release(stage.first.gid)
        stage.world.advance(1)
        assert stage.talker.publish(stage.first, 1, PADDING) == 1


class TestMirrors:
    def test_a_publisher_counts_it_and_sends_it_nothing(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(LOSSLESS)
        mirror = stage.bridge.subscription(LOSSLESS, role="mirror", gid=GID)
        stage.world.settle()
        assert [(one.gid, one.route) for one in publisher.matches] == [(GID, "bridge")]
        assert publisher.get_subscription_count() == publisher._core.count_ready() == 1
        assert [one.current_count for one in stage.changes] == [1]
        assert mirror.get_publisher_count() == 1
        stage.bridge.is_held = True
        for _ in range(200):
            assert stage.talker.publish(publisher, 1, "x" * 100_000) == 1, "nobody waits for it"
            stage.world.settle()
        assert publisher._sender.goes_by_socket is (stage.talker.shm_context is None)
        stage.bridge.is_held = False
        stage.world.settle()
        assert mirror.take() is None and mirror.statistics().expected == 0
        stage.bridge.close(mirror)
        stage.world.settle()
        assert publisher.matches == () and [one.current_count for one in stage.changes] == [1, 0]

    @by_shm
    def test_messages_of_the_moment_in_which_it_is_made_do_not_go_to_busd(self) -> None:
        stage = Stage(shares=True)
        publisher = stage.publisher(LOSSLESS)
        stage.talker.is_held = True
        stage.bridge.subscription(LOSSLESS, role="mirror", gid=GID)
        stage.world.settle()
        stage.talker.publish(publisher, 3)
        stage.talker.is_held = False
        stage.world.settle()
        assert [one.route for one in publisher.matches] == ["bridge"]
        assert publisher._core.sender.socket.next_seq == 1

    def test_it_waits_for_no_message(self, shares: bool) -> None:
        """The endpoint behind the mirror has the deadline, so the mirror itself has none."""
        stage = Stage(shares=shares)
        qos = QoSProfile(3, deadline=0.1)
        stage.publisher(qos)
        mirror = stage.bridge.subscription(qos, role="mirror", gid=GID)
        stage.world.advance(1)
        assert mirror.get_publisher_count() == 1 and mirror._core.deadline is None

    def test_it_is_there_again_after_busd_was_away(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.publisher(LOSSLESS)
        mirror = stage.bridge.subscription(LOSSLESS, role="mirror", gid=GID)
        tap = stage.bridge.subscription(LOSSLESS, role="tap", local_only=True)
        stage.world.settle()
        stage.talker.publish(publisher, 2)
        stage.world.settle()
        stage.world.restart_broker()
        stage.world.connect_all()
        stage.talker.publish(publisher, 2)
        stage.world.advance(15)
        assert [one.route for one in publisher.matches] == ["bridge"]
        assert mirror.take() is None
        assert stage.bridge.take(tap) == [(1, 1), (1, 2), (1, 3), (1, 4)]


class TestGids:
    def test_what_it_publishes_bears_the_gid_of_the_other(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        listener = stage.talker
        subscription = listener.subscription(QoSProfile(5))
        publisher = stage.bridge.publisher(QoSProfile(5), gid=GID)
        stage.world.settle()
        stage.bridge.publish(publisher, 3)
        stage.world.settle()
        assert publisher.gid == GID and [one.gid for one in subscription.matches] == [GID]
        one = subscription.take()
        assert one is not None and one[1].publisher_gid == GID
        assert [info.publisher_gid for _, info in subscription.take_many(5)] == [GID, GID]

    @pytest.mark.parametrize("durability", ["volatile", "transient_local"])
    @pytest.mark.parametrize("busd", ["the same", "a new one"])
    def test_one_that_is_made_anew_is_heard_from_its_first_message_on(
        self, shares: bool, durability: Any, busd: str
    ) -> None:
        stage = Stage(shares=shares)
        qos = QoSProfile(20, durability=durability)
        subscription = stage.talker.subscription(qos)
        self.publish(stage, stage.bridge, qos, 5)
        assert stage.talker.take(subscription) == [(2, number) for number in range(1, 6)]
        stage.bridge.die()
        if busd == "a new one":
            stage.world.restart_broker()
            stage.world.connect_all()
        again = stage.world.client(shares=stage.talker.shm_context is not None, origin=FAR)
        self.publish(stage, again, qos, 3)
        stage.world.advance(15)
        assert stage.talker.take(subscription) == [(3, 1), (3, 2), (3, 3)]
        totals = subscription.statistics()
        assert (totals.expected, totals.dropped) == (8, {})

    def publish(self, stage: Stage, bridge: Client, qos: QoSProfile, count: int) -> None:
        publisher = bridge.publisher(qos, gid=GID)
        stage.world.settle()
        bridge.publish(publisher, count)
        stage.world.settle()

    def test_a_gid_of_another_length(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        with pytest.raises(ConfigurationError, match=r"^gid 6162 of 2 bytes, a gid has 16$"):
            stage.bridge.publisher(QoSProfile(), gid=b"ab")


class TestReportBesides:
    def test_of_a_mirror_subscription(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        mirror = stage.bridge.subscription(QoSProfile(3), role="mirror", gid=GID)
        stage.world.settle()
        mirror.report_besides(samples=1, bytes=10)
        mirror.report_besides(samples=7, bytes=70, dropped={"rate_limit": 2, "too_large": 0})
        found = stage.report()[GID]
        assert (found.samples, found.bytes, found.dropped) == (7, 70, {"rate_limit": 2})
        assert found.expected == 9, "the accounts close"
        assert mirror.statistics().delivered == 0

    def test_of_a_mirror_publisher(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.bridge.publisher(QoSProfile(3), gid=GID)
        stage.world.settle()
        stage.bridge.publish(publisher, 3)
        publisher.report_besides(dropped={"lost_on_the_way": 4})
        found = stage.report()[GID]
        assert (found.samples, found.dropped) == (3, {"lost_on_the_way": 4})
        size = len(SUPPORT.encode(SUPPORT.cls(2, 1, "")))
        assert found.bytes == 3 * size

    def test_a_new_busd_is_told_too(self, shares: bool) -> None:
        stage = Stage(shares=shares)
        publisher = stage.bridge.publisher(QoSProfile(3), gid=GID)
        stage.world.settle()
        publisher.report_besides(dropped={"lost_on_the_way": 4})
        stage.world.restart_broker()
        stage.world.connect_all()
        assert stage.report()[GID].dropped == {"lost_on_the_way": 4}
