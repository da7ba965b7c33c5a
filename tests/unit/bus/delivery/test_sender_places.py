"""bus.delivery.sender with the broker: lost connections lose no sample of a lossless stream."""

import pytest

from bus.qos import QoSProfile
from busd.core.limits import Limits
from by_route import by_shared_memory
from client_world import Client, ClientWorld

KEEP_ALL = QoSProfile(history="keep_all")
WINDOW = 8


class Stream:
    """A talker, and a listener that gets everything by socket."""

    def __init__(self, *, has_ring: bool = False, listener_shares: bool = False) -> None:
        self.world = ClientWorld(Limits(keep_all_window_messages=WINDOW))
        self.talker = self.world.client(shares=has_ring)
        self.listener = self.world.client(shares=listener_shares)
        self.subscription = self.listener.subscription(KEEP_ALL)
        self.world.settle()
        self.publisher = self.talker.publisher(KEEP_ALL)
        self.world.settle()
        self.heard: list[int] = []

    def publish(self, count: int = 1) -> int:
        taken = self.talker.publish(self.publisher, count)
        self.world.settle()
        return taken

    def take(self) -> list[int]:
        found = [number for _, number in self.listener.take(self.subscription)]
        self.heard += found
        self.world.advance(0.1)
        return found

    def cut(self, client: Client) -> None:
        client.hang_up()
        self.world.settle()

    def connect(self, client: Client) -> None:
        client.connect()
        self.world.settle()

    def check(self, dropped: dict[str, int] | None = None) -> None:
        """Check that all published samples were delivered, except those counted in `dropped`."""
        for _ in range(3):
            self.take()
        found, published = self.subscription.statistics(), self.publisher.statistics().published
        assert found.dropped == (dropped or {})
        assert found.expected == published
        assert found.delivered == len(self.heard) == published - sum(found.dropped.values())
        assert self.heard == sorted(set(self.heard))


class TestTheSubscription:
    def test_misses_nothing_of_what_was_on_its_way_or_came_meanwhile(self) -> None:
        stream = Stream()
        stream.listener.connection.is_blocked = True  # type: ignore[union-attr]
        stream.publish(3)
        stream.cut(stream.listener)
        assert stream.publish(2) == 2
        stream.connect(stream.listener)
        assert stream.publish() == 1
        assert stream.take() == [1, 2, 3, 4, 5, 6]
        stream.check()

    def test_time_and_again(self) -> None:
        stream = Stream()
        for _ in range(20):
            stream.publish(3)
            stream.take()
            stream.listener.connection.is_blocked = True  # type: ignore[union-attr]
            stream.publish(3)
            stream.cut(stream.listener)
            stream.publish(3)
            stream.connect(stream.listener)
        stream.check()

    def test_the_publisher_waits_for_it_within_its_window(self) -> None:
        stream = Stream()
        stream.cut(stream.listener)
        assert stream.publish(3 * WINDOW) == WINDOW
        stream.world.advance(9)
        assert stream.publish() == 0
        stream.connect(stream.listener)
        assert stream.publish() == 0
        assert stream.take() == [*range(1, WINDOW + 1)]
        assert stream.publish() == 1
        stream.check()

    def test_no_longer_than_the_lease(self) -> None:
        """The subscription counts the samples lost by then when it returns, even if nothing new is
        published.
        """
        stream = Stream()
        other = stream.world.client().subscription(KEEP_ALL)
        stream.world.settle()
        stream.cut(stream.listener)
        assert stream.publish(3 * WINDOW) == WINDOW
        stream.world.clients[2].take(other)
        stream.world.advance(11)
        assert stream.publish() == 1
        stream.connect(stream.listener)
        stream.check({"disconnected": WINDOW + 1})

    def test_while_another_one_goes_on(self) -> None:
        stream = Stream()
        second = stream.world.client()
        other = second.subscription(KEEP_ALL)
        stream.world.settle()
        stream.publish(3)
        stream.cut(stream.listener)
        stream.publish(3)
        assert len(second.take(other)) == 6
        stream.world.advance(1)
        stream.connect(stream.listener)
        stream.cut(stream.listener)
        stream.connect(stream.listener)
        stream.check()

    def test_busd_dies_while_it_is_away(self) -> None:
        stream = Stream()
        stream.publish(3)
        stream.cut(stream.listener)
        stream.publish(2)
        stream.world.restart_broker()
        stream.world.settle()
        stream.connect(stream.talker)
        stream.publish(2)
        stream.world.advance(2)
        stream.connect(stream.listener)
        stream.check()

    @pytest.mark.parametrize("first", ["talker", "listener"])
    def test_the_publisher_is_lost_too(self, first: str) -> None:
        stream = Stream()
        stream.listener.connection.is_blocked = True  # type: ignore[union-attr]
        stream.publish(3)
        stream.cut(stream.listener)
        stream.publish(1)
        stream.cut(stream.talker)
        stream.publish(1)
        clients = [stream.talker, stream.listener]
        for client in clients if first == "talker" else clients[::-1]:
            stream.connect(client)
            stream.world.advance(1)
        stream.check()


@by_shared_memory
class TestBesideARing:
    def test_what_is_published_meanwhile_goes_to_the_broker_too(self) -> None:
        stream = Stream(has_ring=True)
        stream.publish(2)
        stream.cut(stream.listener)
        stream.publish(3)
        assert stream.publisher._sender.goes_by_socket
        stream.connect(stream.listener)
        assert stream.publish() == 1
        stream.check()

    def test_for_the_lease_and_no_longer(self) -> None:
        stream = Stream(has_ring=True)
        stream.publish(2)
        stream.cut(stream.listener)
        stream.world.advance(11)
        assert not stream.publisher._sender.goes_by_socket
        stream.publish(1)
        stream.connect(stream.listener)
        stream.publish(1)
        stream.take()
        found = stream.subscription.statistics()
        assert found.expected == found.delivered + sum(found.dropped.values()) == 4

    def test_it_comes_back_by_socket_where_that_was_its_route(self) -> None:
        """The ring may have overwritten the missed samples."""
        stream = Stream(has_ring=True, listener_shares=True)
        (match,) = stream.subscription._core.matches
        stream.subscription._core.rings._refuse(stream.subscription._receiver.tracker[match], "a test")  # type: ignore[union-attr]
        stream.world.settle()
        stream.publish(2)
        stream.cut(stream.listener)
        stream.publish(2)
        stream.connect(stream.listener)
        assert [one.route for one in stream.publisher.matches] == ["socket"]
        stream.publish(1)
        stream.check()
