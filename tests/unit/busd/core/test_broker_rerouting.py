"""Effects of a route on the broker's other tasks: history, growth, leaving, gaps in numbers, credit,
lifetimes.
"""

import gc
from weakref import ref

import pytest

from broker_endpoints import Publisher
from broker_line import Pair, note, route
from broker_world import Handle, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.runs import Run
from bus.wire.session import Carried
from busd.core.effects import Flush, Send

ALL = QoSProfile(history="keep_all")
KEPT = QoSProfile(depth=5, durability="transient_local")


class TestHistory:
    def test_is_not_replayed_by_the_broker(self) -> None:
        world = World()
        publisher = world.process(shares=True).publisher("/topic", KEPT)
        publisher.publish("a", "b")
        late = world.process(shares=True).subscription("/topic", KEPT)
        plain = world.process().subscription("/topic", KEPT)
        assert (late.payloads, plain.payloads) == ([], ["a", "b"])

    def test_comes_from_the_publisher_where_the_route_was_refused(self) -> None:
        """Only the publisher knows, for that subscription, where the history ends and what is newer."""
        world = World()
        publisher = world.process(shares=True).publisher("/topic", KEPT)
        publisher.publish("a", "b")
        late = world.process(shares=True).subscription("/topic", KEPT)
        publisher.publish("c")
        late.refuse(publisher)
        assert late.payloads == []
        publisher.catch_up(late, "a", "b", is_replay=True)
        publisher.catch_up(late, "c", first_seq=3)
        publisher.publish("d")
        assert [(one.seq, one.payload) for one in late.samples] == [(1, "a"), (2, "b"), (3, "c"), (4, "d")]
        assert [one.is_replay for one in late.samples] == [True, True, False, False]

    def test_then_does_not_count_against_the_depth(self) -> None:
        world = World()
        publisher = world.process(shares=True).publisher("/topic", KEPT)
        listener = world.process(shares=True)
        late = listener.subscription("/topic", QoSProfile(depth=2, durability="transient_local"))
        late.refuse(publisher)
        listener.is_blocked = True
        publisher.catch_up(late, "a", "b", is_replay=True)
        publisher.catch_up(late, "c", "d", first_seq=3)
        listener.unblock()
        assert late.payloads == ["a", "b", "c", "d"]


class TestLeavingTheRing:
    """Samples that the subscription has read do not come again, are no loss, and block no publisher."""

    def test_it_has_had_everything(self) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic")
        pair.listener.has_read = 5
        subscription.refuse(publisher)
        publisher.catch_up(subscription)
        publisher.lose(3)
        publisher.publish("4", "5")
        publisher.publish("6")
        assert (subscription.payloads, plain.payloads) == (["6"], ["4", "5", "6"])
        totals = subscription.statistics()
        assert (totals.expected, totals.dropped) == (1, {})

    def test_it_has_read_on_since_it_came_back(self) -> None:
        world = World()
        talker, listener = world.process(shares=True), world.process(shares=True)
        publisher = talker.publisher("/topic")
        subscription = listener.node().subscription("/topic", last_seqs={publisher.gid: 100})
        listener.has_read = 500
        subscription.refuse(publisher)
        publisher.catch_up(subscription)
        publisher.resume(501)
        publisher.publish("next")
        totals = subscription.statistics()
        assert (totals.expected, totals.dropped) == (1, {})

    def test_a_publisher_that_keeps_all_does_not_wait_for_it(self) -> None:
        pair = Pair(ALL, ALL)
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic", ALL)
        pair.listener.is_blocked = True
        subscription.refuse(publisher)
        publisher.publish("a", "b", "c")
        plain.ack(publisher, 3)
        assert publisher.got(m.Credit) == []
        pair.listener.has_read = 3
        pair.listener.unblock()
        assert publisher.got(m.Credit) == [m.Credit(publisher=publisher.id, seq=3)]

    def test_nor_for_what_is_too_large_for_it(self) -> None:
        pair = Pair(ALL, ALL)
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic", ALL)
        subscription.refuse(publisher)
        publisher.publish("a", "b")
        plain.ack(publisher, 2)
        pair.world.broker.graph.publishers[publisher.id].max_message_bytes = 10
        assert publisher.got(m.Credit) == []
        publisher.catch_up(subscription, "a" * 11, "b" * 11)
        assert publisher.got(m.Credit) == [m.Credit(publisher=publisher.id, seq=2)]
        assert subscription.statistics().dropped == {"too_large": 2}

    def test_the_publisher_goes_meanwhile(self) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        subscription.refuse(publisher)
        publisher.catch_up(subscription, *"abc")
        publisher.destroy()
        assert [told.last_seq for told in subscription.got(m.Unmatched)] == [3]


class TestGrowing:
    def grow(self, publisher: Publisher, *ring: str) -> None:
        publisher.process.tell(m.ReplaceRing(publisher=publisher.id), *ring)

    @pytest.mark.parametrize("is_attached", [True, False])
    def test_all_that_read_it_are_told(self, is_attached: bool) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        if is_attached:
            subscription.attach(publisher)
        plain = pair.world.process().subscription("/topic")
        self.grow(publisher, "larger")
        told = m.RingReplaced(subscription=subscription.id, source=publisher.id)
        assert pair.listener.carried[1:] == [(told, ["larger"])]
        assert not plain.got(m.RingReplaced)
        late = pair.world.process(shares=True)
        late.subscription("/topic")
        assert [names for _, names in late.carried] == [["larger", f"doorbell {pair.talker.id}"]]

    def test_the_new_one_was_lost(self) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        self.grow(publisher)
        assert publisher.got(m.Rerouted) and subscription.got(m.Rerouted)
        assert route(publisher, subscription) == "socket"
        assert note(pair.world, "go by socket: its new ring was lost")
        late = pair.world.process(shares=True).subscription("/topic")
        assert route(publisher, late) == "socket"
        self.grow(publisher, "another")
        latest = pair.world.process(shares=True).subscription("/topic")
        assert [route(publisher, one) for one in (subscription, late, latest)] == ["socket", "socket", "shm"]

    def test_another_s(self) -> None:
        pair = Pair()
        pair.listener.tell(m.ReplaceRing(publisher=pair.publisher.id), "mine")
        assert pair.listener.cut_reason == f"endpoint {pair.publisher.id} is not one of yours"

    def test_a_subscription_s(self) -> None:
        pair = Pair()
        pair.listener.tell(m.ReplaceRing(publisher=pair.subscription.id), "mine")
        assert pair.listener.cut_reason == f"endpoint {pair.subscription.id} is not a publisher"


@pytest.mark.parametrize("stage", ["matched", "attached", "rerouted"])
@pytest.mark.parametrize("how", ["endpoint", "process"])
class TestLeaving:
    def pair(self, stage: str) -> Pair:
        pair = Pair(ALL, ALL)
        if stage == "attached":
            pair.subscription.attach(pair.publisher)
        elif stage == "rerouted":
            pair.subscription.refuse(pair.publisher)
        return pair

    def test_the_publisher(self, stage: str, how: str) -> None:
        pair = self.pair(stage)
        publisher, subscription = pair.match()
        if how == "endpoint":
            publisher.destroy()
        else:
            pair.talker.die()
        assert len(subscription.got(m.Unmatched)) == 1
        assert pair.listener.graph().matches == ()
        again = pair.world.process(shares=True).publisher("/topic", ALL)
        assert route(again, subscription) == "shm"

    def test_the_subscription(self, stage: str, how: str) -> None:
        pair = self.pair(stage)
        publisher, subscription = pair.match()
        if how == "endpoint":
            subscription.destroy()
        else:
            pair.listener.die()
        assert len(publisher.got(m.Unmatched)) == 1
        assert pair.talker.graph().matches == ()
        again = pair.world.process(shares=True).subscription("/topic", ALL)
        assert route(publisher, again) == "shm"


class TestResuming:
    def test_numbers_that_went_another_way_are_not_lost(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        subscription = world.process().subscription("/topic")
        publisher.publish("a")
        publisher.resume(10)
        publisher.publish("b")
        publisher.lose(2)
        publisher.publish("c")
        assert [one.seq for one in subscription.samples] == [1, 10, 13]
        assert subscription.statistics().dropped == {"publisher_queue": 2}

    def test_they_do_not_go_back(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        publisher.publish("a", "b")
        publisher.resume(2)
        publisher.publish("b")
        assert publisher.process.cut_reason == f"publisher {publisher.id} sent sample 2 after 2"

    def test_a_gap_is_no_loss_of_those_that_read_the_ring(self) -> None:
        pair = Pair()
        pair.publisher.lose(3)
        pair.publisher.publish("x")
        assert pair.subscription.statistics().dropped == {}

    def test_subscriptions_are_not_told(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic")
        listener = world.process()
        listener.subscription("/topic")
        run = Run(publisher.id, 0, 5, 1, bytes(12), is_resumed=True)
        (effect,) = world.broker.route(world.now_ns, publisher.process.id, run)
        assert isinstance(effect, Flush)
        assert not effect.queue.runs[0].is_resumed


class TestCredit:
    """For reliable and keep all, the broker gives credit only for subscriptions by socket."""

    def credits(self, publisher: Publisher) -> list[int]:
        return [message.seq for message in publisher.got(m.Credit)]

    def test_those_that_read_the_ring_are_not_waited_for(self) -> None:
        pair = Pair(ALL, ALL)
        plain = pair.world.process().subscription("/topic", ALL)
        pair.publisher.publish("a", "b")
        plain.ack(pair.publisher, 2)
        assert self.credits(pair.publisher) == [2]
        pair.subscription.ack(pair.publisher, 1)
        assert pair.listener.cut_reason is None

    def test_from_the_socket_on_they_are(self) -> None:
        pair = Pair(ALL, ALL)
        publisher, subscription = pair.match()
        subscription.refuse(publisher)
        publisher.resume(8)
        publisher.publish("a", "b", "c")
        assert self.credits(publisher) == []
        subscription.ack(publisher, 9)
        subscription.ack(publisher, 10)
        assert self.credits(publisher) == [9, 10]

    def test_what_was_taken_from_the_ring_is_credited_when_it_comes(self) -> None:
        pair = Pair(ALL, ALL)
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic", ALL)
        subscription.attach(publisher)
        subscription.refuse(publisher)
        publisher.publish("1", "2")
        subscription.ack(publisher, 4)
        plain.ack(publisher, 2)
        assert self.credits(publisher) == [2]
        publisher.publish("3", "4")
        assert self.credits(publisher) == [2]
        plain.ack(publisher, 4)
        assert self.credits(publisher) == [2, 4]

    def test_all_were_ahead(self) -> None:
        """No further acknowledgement will come, and the publisher must not wait for ever."""
        pair = Pair(ALL, ALL)
        publisher, subscription = pair.match()
        subscription.refuse(publisher)
        subscription.ack(publisher, 4)
        assert self.credits(publisher) == []
        publisher.publish("1", "2")
        publisher.publish("3", "4")
        assert self.credits(publisher) == [2, 4]
        publisher.publish("5")
        assert self.credits(publisher) == [2, 4]
        assert pair.listener.cut_reason is None


class TestLifetime:
    """The broker closes an unused descriptor at once, not at a garbage collection."""

    def test_nothing_is_left(self) -> None:
        world = World()
        talker, listener = world.process(), world.process()
        qos = QoSProfile(liveliness_lease_duration=60.0, durability="transient_local")
        handles = {
            name: Handle(name) for name in ("bell", "readers", "ring", "larger", "other bell", "other")
        }
        known = {name: ref(handle) for name, handle in handles.items()}

        def carry(process: int, message: m.Message, *names: str) -> None:
            """Act like the shell, without a wire that keeps descriptors."""
            item = Carried(message, tuple(handles.pop(name) for name in names))  # type: ignore[arg-type]
            effects = world.broker.handle(world.now_ns, process, item.message, item.descriptors)  # type: ignore[arg-type]
            assert all(isinstance(effect, Send) for effect in effects if not isinstance(effect, Flush))

        gc.collect()
        gc.disable()
        try:
            carry(talker.id, m.Share(), "bell", "readers")
            carry(listener.id, m.Share(), "other bell", "other")
            listener.subscription("/topic", qos)
            node = talker.node("talker")
            talker.declare_type(("test_msgs/msg/Text", "hash-1"))
            message = m.CreatePublisher(
                request=9,
                node=node.id,
                topic="/topic",
                type_name="test_msgs/msg/Text",
                type_hash="hash-1",
                qos=qos,
                gid=bytes(16),
                descriptors=1,
            )
            carry(talker.id, message, "ring")
            assert all(known[name]() for name in ("bell", "readers", "ring"))
            (publisher,) = world.broker.graph.publishers
            carry(talker.id, m.ReplaceRing(publisher=publisher), "larger")
            assert known["ring"]() is None and known["larger"]() is not None
            talker.tell(m.DestroyEndpoint(endpoint=publisher))
            assert known["larger"]() is None
            talker.die()
            assert known["bell"]() is None and known["readers"]() is None
            listener.tell(m.DestroyNode(node=-1))
            assert not any(handle() for handle in known.values())
        finally:
            gc.enable()
