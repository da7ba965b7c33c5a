"""Accounts of a subscription and a publisher: every message is delivered, queued, or dropped with a reason.

The world has no process, no socket and no clock (`tests/world/client_world.py`).
"""

from typing import Any

from bus.qos import QoSProfile
from bus.subscription import Subscription
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from by_route import by_shared_memory
from client_world import SUPPORT, ClientWorld, Numbered

LAST_3, LAST_10 = QoSProfile(3), QoSProfile(10)
KEEP_ALL = QoSProfile(history="keep_all")


class Pair:
    def __init__(self, route: str, offered: QoSProfile = LAST_10, requested: QoSProfile = LAST_10) -> None:
        self.world = ClientWorld()
        self.talker = self.world.client(shares=route == "shm")
        self.listener = self.world.client(shares=route == "shm")
        self.subscription: Subscription[Any] = self.listener.subscription(requested)
        self.publisher = self.talker.publisher(offered)
        self.world.settle()

    def publish(self, count: int = 1) -> None:
        assert self.talker.publish(self.publisher, count) == count
        self.world.settle()

    def publish_from_thread(self, count: int = 1) -> None:
        self.talker.is_mine = False
        for number in range(1, count + 1):
            assert self.publisher._put(SUPPORT.encode(Numbered(2, number)))
        self.talker.is_mine = True

    def heard(self) -> list[int]:
        return [number for _, number in self.listener.take(self.subscription)]

    def closes(self) -> dict[str, int]:
        """Check that the account of expected messages balances, and return the dropped ones."""
        found = self.subscription.statistics()
        assert found.expected == found.delivered + found.queued + sum(found.dropped.values())
        return found.dropped

    def restart(self) -> None:
        self.world.restart_broker()
        self.world.settle()
        self.world.connect_all()
        self.world.settle()

    def reconnect(self) -> None:
        self.listener.hang_up()
        self.world.settle()
        self.listener.connect()
        self.world.settle()


def flood(pair: Pair, count: int) -> None:
    """Publish more than the depth while the subscription's process reads nothing, so the broker drops the
    rest.
    """
    pair.listener.is_held = True
    process = pair.listener.connection
    assert process is not None
    process.is_blocked = True
    for _ in range(count):
        pair.publish()
    process.is_blocked = False
    pair.listener.is_held = False
    process.unblock()
    pair.world.settle()


def test_what_each_of_several_brokers_dropped_counts_once() -> None:
    pair = Pair("socket", LAST_3, LAST_3)
    for round in (1, 2, 3):
        flood(pair, 8)
        pair.world.advance(2)
        assert pair.heard() == [8 * round - 2, 8 * round - 1, 8 * round]
        assert pair.closes() == {"replaced": 5 * round}
        pair.restart()
        assert pair.closes() == {"replaced": 5 * round}


def test_what_is_missing_in_the_numbers_and_what_the_broker_tells_of_it_are_one_loss() -> None:
    pair = Pair("socket", LAST_3, LAST_3)
    pair.publish()
    assert pair.heard() == [1]
    flood(pair, 8)
    pair.world.advance(2)
    assert pair.heard() == [7, 8, 9]
    assert pair.closes() == {"replaced": 5}
    assert pair.subscription.statistics().expected == 9


@by_shared_memory
def test_what_a_ring_gave_up_before_the_match_went_by_socket_is_counted_here() -> None:
    pair = Pair("shm", LAST_3)
    pair.publish(2)
    assert pair.heard() == [1, 2]
    refusal = m.RefuseRoute(endpoint=pair.subscription._core.id, other=pair.publisher._core.id, text="a test")
    pair.listener.send_about(pair.subscription._core, refusal)
    while pair.listener.step() | pair.listener.serve():
        pass  # the subscription has left the ring, and its publisher does not know it yet
    pair.talker.publish(pair.publisher, 100, "x" * 20_000)
    pair.world.settle()
    pair.publish()
    heard = pair.heard()
    assert heard[-1] == 103
    lost = 101 - len(heard)
    assert lost > 0
    assert pair.closes() == {"replaced": lost}
    assert 2 < pair.subscription._core.counters.expected_here < 103 - 3, "the others were sent to it alone"


def test_what_came_by_an_earlier_connection_the_present_broker_did_not_route() -> None:
    pair = Pair("socket")
    pair.publish(5)
    assert pair.heard() == [1, 2, 3, 4, 5]
    assert pair.subscription._core.counters.expected_here == 0
    pair.reconnect()
    assert pair.subscription._core.counters.expected_here == 5
    pair.publish(2)
    assert pair.heard() == [6, 7]
    assert pair.subscription._core.counters.expected_here == 5
    assert pair.closes() == {}


class TestReasonsThatAreToldLater:
    """After its process was away, a subscription learns how many messages were lost, and why."""

    GID = b"g" * 16

    @staticmethod
    def dropped(before: int, last_seq: int) -> m.Dropped:
        missed = {TestReasonsThatAreToldLater.GID: (1, last_seq)}
        return m.Dropped(subscription=1, dropped={}, missed=missed, before={"replaced": before})

    def test_count_once_however_often_they_are_told(self) -> None:
        subscription = Pair("socket").subscription
        counters = subscription._core.counters
        counters.on_dropped(m.Dropped(subscription=1, dropped={"replaced": 2}))
        counters.disconnected("a broker")
        counters.on_dropped(self.dropped(before=5, last_seq=10))
        found = subscription.statistics()
        assert found.dropped == {"replaced": 5, "disconnected": 5}
        assert found.expected == 10

    def test_are_those_of_one_broker(self) -> None:
        subscription = Pair("socket").subscription
        counters = subscription._core.counters
        counters.on_dropped(m.Dropped(subscription=1, dropped={"replaced": 2}))
        counters.disconnected("a broker")
        counters.on_dropped(m.Dropped(subscription=1, dropped={"replaced": 1}))
        counters.disconnected("another broker")
        counters.on_dropped(self.dropped(before=4, last_seq=10))
        found = subscription.statistics()
        assert found.dropped == {"replaced": 6, "disconnected": 4}
        assert found.expected == 10


def test_who_tells_of_more_than_can_be_counted_is_not_believed() -> None:
    subscription = Pair("socket").subscription
    for broker in range(3):
        subscription._core.counters.on_dropped(m.Dropped(subscription=1, dropped={"replaced": MAX_COUNT}))
        subscription._core.counters.disconnected(broker)
    assert subscription.statistics().dropped == {"replaced": MAX_COUNT}


class TestOfAPublisher:
    def test_what_other_threads_publish_beyond_the_depth_is_replaced(self) -> None:
        pair = Pair("socket")
        pair.publish_from_thread(25)
        pair.world.settle()
        found = pair.publisher.statistics()
        assert (found.published, found.replaced) == (25, 15)
        assert pair.heard() == [*range(16, 26)]

    def test_what_waits_is_counted_wherever_it_does(self) -> None:
        pair = Pair("socket")
        pair.talker.hang_up()
        assert pair.talker.publish(pair.publisher, 3) == 3
        assert pair.publisher.statistics().queued == 3
        pair.world.settle()
        found = pair.publisher.statistics()
        assert (found.published, found.queued, found.replaced) == (3, 3, 0)

    def test_what_could_not_be_handed_over_in_the_end_is_counted(self) -> None:
        pair = Pair("socket")
        pair.talker.hang_up()
        assert pair.talker.publish(pair.publisher, 3) == 3
        pair.world.settle()
        assert pair.publisher._sender.drop_queued() == 3
        found = pair.publisher.statistics()
        assert (found.published, found.queued, found.replaced) == (3, 0, 3)
