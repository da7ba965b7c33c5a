"""bus.delivery.sender with a whole bus: both routes at once, and changes from one to the other.

The world has no process, no socket and no clock (`tests/world/client_world.py`).
"""

from typing import Any

import pytest

from bus.errors import ConnectionClosed, ForkError, LocalProtocolError
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.subscription import Subscription
from by_route import by_either, by_shared_memory
from client_world import Client, ClientWorld, Numbered
from list_port import Task
from sender_pair import HISTORY, KEEP_ALL, LAST_10, PADDING, Pair, heard


def sending(client: Client, publisher: Publisher[Numbered], padding: str = PADDING) -> Task:
    """A task that waits for room and then publishes."""

    async def send() -> None:
        while not client.publish(publisher, 1, padding):
            await publisher.wait_for_room()

    return Task(client.soon, send())


def closes(subscription: Subscription[Numbered]) -> bool:
    found = subscription.statistics()
    return found.expected == found.delivered + found.queued + sum(found.dropped.values())


class TestOrder:
    @by_either
    def test_what_is_published_comes_in_its_order(self, route: str) -> None:
        pair = Pair(route)
        for count in (1, 3, 5):
            pair.publish(count)
        assert pair.heard() == [*range(1, 10)]
        assert closes(pair.subscription)

    @by_either
    def test_beyond_the_depth_the_newest_stay(self, route: str) -> None:
        pair = Pair(route)
        pair.publish(25)
        assert pair.heard() == [*range(16, 26)]
        assert pair.dropped == {"replaced": 15}

    @by_shared_memory
    def test_one_by_each_route_and_both_get_all(self) -> None:
        pair = Pair("shm")
        far = pair.world.client()
        other = far.subscription(LAST_10)
        pair.world.settle()
        pair.publish(3)
        assert sorted(match.route for match in pair.publisher.matches) == ["shm", "socket"]
        assert pair.heard() == heard(far, other) == [1, 2, 3]

    @by_shared_memory
    def test_one_by_socket_that_comes_while_messages_are_on_their_way(self) -> None:
        """New samples are for an existing subscription, even if the publisher does not know it yet."""
        pair = Pair("shm")
        far = pair.world.client()
        pair.publish(2)
        other = far.subscription(LAST_10)
        while far.serve():
            pass
        assert pair.talker.publish(pair.publisher, 3) == 3
        pair.world.settle()
        assert heard(far, other) == [3, 4, 5]
        assert other.statistics().dropped == {}

    @by_shared_memory
    def test_when_the_last_by_socket_leaves_the_ring_goes_on_alone(self) -> None:
        pair = Pair("shm")
        far = pair.world.client()
        other = far.subscription(LAST_10)
        pair.world.settle()
        pair.publish(1)
        sender = pair.publisher._sender
        assert sender.goes_by_socket
        far.close(other)
        pair.publish(1)
        assert not sender.goes_by_socket
        again = far.subscription(LAST_10)
        pair.world.settle()
        pair.publish(1)
        assert sender.goes_by_socket
        assert (pair.heard(), heard(far, again)) == ([1, 2, 3], [3])
        assert again.statistics().dropped == {}


class TestHistory:
    @by_either
    @pytest.mark.parametrize(("offered", "requested"), [(3, 10), (10, 3), (10, 10)])
    def test_a_late_one_gets_as_much_as_both_keep(self, route: str, offered: int, requested: int) -> None:
        pair = Pair(route, QoSProfile(offered, durability="transient_local"), LAST_10)
        pair.publish(20)
        late = pair.listener.subscription(QoSProfile(requested, durability="transient_local"))
        pair.world.settle()
        pair.publish(1)
        assert heard(pair.listener, late) == [*range(21 - min(offered, requested), 22)]
        assert closes(late)

    @by_shared_memory
    def test_a_late_one_by_socket_gets_what_is_on_its_way_to_busd(self) -> None:
        pair = Pair("shm", HISTORY)
        pair.publish(2)
        pair.talker.publish(pair.publisher, 2)  # busd has not received these yet
        other = pair.world.client(shares=False)
        late = other.subscription(HISTORY)
        pair.world.settle()
        pair.publish(1)
        assert heard(other, late) == pair.heard() == [1, 2, 3, 4, 5]

    @by_either
    @pytest.mark.parametrize(("offered", "got"), [(HISTORY, [*range(1, 7)]), (LAST_10, [6])])
    def test_one_that_takes_any_history(self, route: str, offered: QoSProfile, got: list[int]) -> None:
        pair = Pair(route, offered, LAST_10)
        pair.publish(5)
        late = pair.listener.subscription(QoSProfile(10, durability="best_available"))
        pair.world.settle()
        pair.publish(1)
        assert heard(pair.listener, late) == got
        assert closes(late)

    @by_either
    @pytest.mark.parametrize("offered", [HISTORY, LAST_10])
    def test_one_that_takes_any_history_and_a_new_broker(self, route: str, offered: QoSProfile) -> None:
        pair = Pair(route, offered, QoSProfile(10, durability="best_available"))
        pair.publish(5)
        assert pair.heard() == [1, 2, 3, 4, 5]
        pair.world.restart_broker()
        pair.world.connect_all()
        pair.publish(1)
        assert pair.heard() == [6]

    @by_either
    def test_a_late_one_that_wants_none_gets_none(self, route: str) -> None:
        pair = Pair(route, HISTORY, LAST_10)
        pair.publish(5)
        late = pair.listener.subscription(LAST_10)
        pair.world.settle()
        pair.publish(1)
        assert heard(pair.listener, late) == [6]

    @by_either
    def test_a_new_broker_has_it_too(self, route: str) -> None:
        pair = Pair(route, HISTORY)
        pair.publish(5)
        pair.world.restart_broker()
        pair.world.connect_all()
        late = pair.listener.subscription(HISTORY)
        pair.world.settle()
        assert heard(pair.listener, late) == pair.heard() == [1, 2, 3, 4, 5]


class TestReroute:
    """The match moves to the socket route; no sample is lost or delivered twice."""

    @by_shared_memory
    @pytest.mark.parametrize("taken", [0, 2, 4])
    def test_in_the_midst_of_the_stream(self, taken: int) -> None:
        pair = Pair("shm")
        pair.publish(4)
        found = [number for _, number in pair.listener.take(pair.subscription, taken)]
        pair.refuse()
        pair.talker.publish(pair.publisher, 2)
        pair.world.settle()
        assert pair.route() == "socket"
        pair.publish(2)
        assert found + pair.heard() == [*range(1, 9)]
        assert pair.dropped == {} and closes(pair.subscription)

    @by_shared_memory
    def test_before_the_reader_has_said_where_it_is(self) -> None:
        world = ClientWorld()
        talker, listener = world.client(shares=True), world.client(shares=True)
        publisher = talker.publisher(LAST_10)
        world.settle()
        subscription = listener.subscription(LAST_10)
        while listener.serve():
            pass
        talker.publish(publisher, 3)
        context: Any = listener.shm_context
        context._free.clear()  # no slot is left, so the ring can't be read
        world.settle()
        talker.publish(publisher, 2)
        world.settle()
        assert [match.route for match in publisher.matches] == ["socket"]
        assert heard(listener, subscription) == [1, 2, 3, 4, 5]
        assert subscription.statistics().dropped == {}

    @by_shared_memory
    def test_the_graph_hears_what_has_become_of_what_was_in_the_ring(self) -> None:
        """The graph learns it even if nothing is published afterwards."""
        pair = Pair("shm", QoSProfile(3))
        pair.refuse()
        while pair.listener.serve():
            pass
        pair.publish(5)
        assert pair.heard() == [3, 4, 5]
        pair.world.advance(1)
        graph = pair.world.whole_graph(statistics=True)
        (found,) = (one.statistics for one in graph.endpoints if one.gid == pair.subscription.gid)
        assert found is not None
        assert (found.samples, found.expected, found.dropped) == (3, 5, {"replaced": 2})

    @by_shared_memory
    def test_of_one_that_keeps_all(self) -> None:
        pair = Pair("shm", KEEP_ALL)
        pair.publish(4)
        pair.refuse()
        pair.publish(4)
        assert pair.heard() == [*range(1, 9)]
        assert pair.dropped == {}


class TestKeepAll:
    @by_either
    def test_publish_returns_false_while_the_window_is_full(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        first = pair.publish(10_000, PADDING)
        assert 10 < first < 10_000
        assert pair.publish(1, PADDING) == 0
        assert len(pair.listener.take(pair.subscription)) == first
        pair.world.advance(0.1)
        again = pair.publish(10_000, PADDING)
        assert again > first // 2
        assert pair.heard() == [*range(first + 1, first + again + 1)]
        assert pair.dropped == {}

    @by_either
    def test_one_that_waits_goes_on_when_something_was_taken(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(10_000, PADDING)
        task = sending(pair.talker, pair.publisher)
        pair.world.advance(5)
        assert not task.is_done
        pair.heard()
        pair.world.advance(0.1)
        assert task.is_done and task.error is None
        assert len(pair.heard()) == 1

    @by_either
    @pytest.mark.parametrize("how", ["closed", "killed", "hung up"])
    def test_one_that_waits_goes_on_when_the_one_that_it_waits_for_has_left(
        self, route: str, how: str
    ) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(10_000, PADDING)
        task = sending(pair.talker, pair.publisher)
        pair.world.settle()
        assert not task.is_done
        if how == "closed":
            pair.listener.close(pair.subscription)
        elif how == "killed":
            pair.listener.die()
        else:
            pair.listener.hang_up()
            pair.world.advance(8)
            assert task.is_done is (route == "shm"), "by socket it may come back, and then misses nothing"
        pair.world.advance(2.5)
        assert task.is_done and task.error is None

    @by_either
    def test_one_that_waits_hears_of_the_end(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(10_000, PADDING)
        task = sending(pair.talker, pair.publisher)
        pair.world.settle()
        pair.talker.close(pair.publisher)
        pair.world.settle()
        assert isinstance(task.error, ConnectionClosed)

    @by_either
    @pytest.mark.parametrize("has_news", [False, True], ids=["busd silent", "busd has news"])
    def test_one_that_was_refused_and_waits_later_goes_on_though_all_was_taken_meanwhile(
        self, route: str, has_news: bool
    ) -> None:
        """`publish` finds no room in one turn of the loop, and the caller waits in a later one. No task is
        left then to wake it. `has_news`: there may be readers that the publisher does not know yet."""
        pair = Pair(route, KEEP_ALL)
        pair.talker._is_receiving = has_news
        pair.talker.publish(pair.publisher, 10_000, PADDING)
        pair.talker._is_receiving = False
        pair.world.settle()
        pair.heard()
        pair.world.advance(1)
        task = Task(pair.talker.soon, pair.publisher.wait_for_room())
        pair.world.advance(0.1)
        assert task.is_done and task.error is None
        assert pair.publish(1, PADDING) == 1

    @by_either
    def test_one_that_was_refused_and_closed_and_waits_later_hears_of_the_end(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(10_000, PADDING)
        pair.talker.close(pair.publisher)
        task = Task(pair.talker.soon, pair.publisher.wait_for_room())
        pair.world.settle()
        assert isinstance(task.error, ConnectionClosed)

    @by_shared_memory
    def test_of_two_that_wait_one_that_finds_room_before_its_sleep_wakes_the_other(self) -> None:
        pair = Pair("shm", KEEP_ALL)
        pair.publish(10_000, PADDING)
        first = sending(pair.talker, pair.publisher)
        pair.world.settle()
        ring = pair.publisher._sender.ring
        assert ring is not None
        ring.writer.woken()  # the second task does this if a message is taken while it goes to sleep
        pair.heard()
        pair.world.settle()
        assert not first.is_done
        second = Task(pair.talker.soon, pair.publisher.wait_for_room())
        pair.world.advance(0.1)
        assert second.is_done and first.is_done and first.error is None

    @by_shared_memory
    def test_while_one_waits_for_room_by_socket_nothing_turns_though_the_ring_has_room(self) -> None:
        pair = Pair("shm", KEEP_ALL)
        far = pair.world.client()
        other = far.subscription(KEEP_ALL)
        pair.world.settle()
        while pair.publish(1, PADDING):
            pair.heard()
        task = sending(pair.talker, pair.publisher)
        pair.world.settle()  # fails if a task runs on for ever
        assert not task.is_done
        assert heard(far, other)
        pair.world.advance(0.1)
        assert task.is_done and task.error is None

    @by_either
    def test_without_a_broker_too_nobody_waits_for_one_that_was_killed(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(10_000, PADDING)
        task = sending(pair.talker, pair.publisher)
        pair.world.restart_broker()
        pair.world.settle()
        pair.listener.die()
        if route == "socket":  # the window belongs to busd, so only the next broker makes room
            pair.talker.connect()
        pair.world.advance(2.5)
        assert task.is_done and task.error is None


class TestBrokerThatDies:
    @by_either
    @pytest.mark.parametrize("qos", [LAST_10, KEEP_ALL, HISTORY], ids=["last", "all", "history"])
    def test_nothing_is_lost_and_nothing_comes_twice(self, route: str, qos: QoSProfile) -> None:
        pair = Pair(route, qos)
        pair.publish(2)
        pair.world.restart_broker()
        pair.world.settle()
        pair.publish(2)
        pair.world.connect_all()
        pair.publish(2)
        pair.world.advance(15)
        pair.publish(1)
        assert pair.heard() == [*range(1, 8)]
        assert pair.dropped == {} and closes(pair.subscription)

    @by_either
    def test_the_talker_is_back_long_before_the_listener(self, route: str) -> None:
        pair = Pair(route, KEEP_ALL)
        pair.publish(2)
        pair.world.restart_broker()
        pair.world.settle()
        pair.talker.connect()
        pair.publish(2)
        pair.world.advance(5)
        pair.listener.connect()
        pair.world.advance(1)
        assert pair.heard() == [1, 2, 3, 4]
        assert pair.dropped == {}

    @by_shared_memory
    def test_what_waited_for_one_that_has_left_is_no_surprise_to_the_next_broker(self) -> None:
        """The declaration tells it. Otherwise the number would seem to go back, which ends the connection."""
        world = ClientWorld()
        talker, far = world.client(shares=True), world.client()
        subscription = far.subscription(LAST_10)
        world.settle()
        publisher = talker.publisher(LAST_10)
        world.settle()
        talker.is_choked = True
        talker.publish(publisher, 3)
        world.settle()
        far.close(subscription)
        world.settle()
        assert not publisher._sender.goes_by_socket and publisher._sender.queued == 3
        talker.hang_up()
        talker.unchoke()
        world.connect_all()
        assert talker.connection is not None and talker.connection.cut_reason is None

    @by_either
    def test_a_connection_alone_that_ends_and_comes_back(self, route: str) -> None:
        for which in ("talker", "listener"):
            pair = Pair(route)
            pair.publish(2)
            getattr(pair, which).hang_up()
            pair.publish(2)
            pair.world.connect_all()
            pair.publish(2)
            assert closes(pair.subscription)
            found = pair.heard()
            assert {1, 2, 5, 6} <= set(found)
            assert len(found) + sum(pair.dropped.values()) == 6, which


class TestLoan:
    @by_either
    def test_nothing_else_is_published_while_it_is_open(self, route: str) -> None:
        pair = Pair(route)
        payload = Numbered(pair.world.number_of(pair.publisher._core), 1)
        encoded = pair.publisher._encode(payload)
        loan = pair.publisher._sender.lend(b"", len(encoded), b"")
        assert loan is not None
        with pytest.raises(LocalProtocolError, match="is open"):
            pair.publish()
        loan.buffer[:] = encoded
        assert loan.publish()
        pair.publish()
        assert pair.heard() == [1, 2]

    @by_shared_memory
    def test_a_match_that_is_made_meanwhile_takes_nothing_away(self) -> None:
        world = ClientWorld()
        talker, listener = world.client(shares=True), world.client(shares=True)
        publisher = talker.publisher(LAST_10)
        world.settle()
        encoded = publisher._encode(Numbered(world.number_of(publisher._core), 1))
        loan = publisher._sender.lend(b"", len(encoded), b"")
        assert loan is not None
        subscription = listener.subscription(LAST_10)
        world.settle()
        loan.buffer[:] = encoded
        assert loan.publish()
        world.settle()
        assert heard(listener, subscription) == [1]


class TestEnd:
    @by_either
    def test_what_was_published_before_is_read(self, route: str) -> None:
        pair = Pair(route)
        pair.talker.publish(pair.publisher, 3)
        pair.talker.close(pair.publisher)
        pair.world.settle()
        assert pair.heard() == [1, 2, 3]
        assert closes(pair.subscription)
        with pytest.raises(ConnectionClosed):
            pair.publish()
        assert pair.publisher.statistics().published == 3

    @by_shared_memory
    def test_of_a_killed_process_what_is_in_the_ring_is_read(self) -> None:
        pair = Pair("shm")
        pair.talker.publish(pair.publisher, 3)
        pair.talker.die()
        pair.world.settle()
        assert pair.heard() == [1, 2, 3]
        assert pair.dropped == {} and closes(pair.subscription)

    @by_either
    def test_in_the_child_of_a_fork_nothing_of_the_port_is_touched(self, route: str) -> None:
        pair = Pair(route)
        pair.talker.publish(pair.publisher, 3)
        port = pair.talker
        assert port.connection is not None
        before = len(port.calls), len(port.connection.sent_up), port.clock.now_ns
        pair.publisher._core.abandon(ForkError("forked"))
        with pytest.raises(ForkError):
            pair.publisher._put(b"x")
        assert (len(port.calls), len(port.connection.sent_up), port.clock.now_ns) == before
        assert pair.publisher.statistics().published == 0
