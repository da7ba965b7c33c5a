"""Reliable and keep all: the publisher's credit depends on the slowest subscription."""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits, TopicRule
from rows import for_each

KIB = 1024
ALL = QoSProfile(history="keep_all")
LIMITS = Limits(keep_all_window_messages=80, keep_all_window_bytes=8 * KIB)


def credits(publisher: Publisher) -> list[int]:
    return [message.seq for message in publisher.got(m.Credit)]


def pair(count: int = 1, offered: QoSProfile = ALL) -> tuple[World, Publisher, list[Subscription]]:
    world = World(LIMITS)
    publisher = world.process().publisher("/topic", offered)
    return world, publisher, [world.process().subscription("/topic", ALL) for _ in range(count)]


class TestAcks:
    def test_the_window_is_told(self) -> None:
        _, publisher, _ = pair()
        assert (publisher.created.window_samples, publisher.created.window_bytes) == (80, 8 * KIB)

    def test_no_credit_before_it_was_taken(self) -> None:
        _, publisher, _ = pair()
        publisher.publish_many(str(at) for at in range(200))
        assert credits(publisher) == []

    def test_an_ack_gives_credit(self) -> None:
        _, publisher, (subscription,) = pair()
        publisher.publish(*"abcde")
        subscription.ack(publisher, 3)
        subscription.ack(publisher, 5)
        assert credits(publisher) == [3, 5]

    def test_said_again_it_gives_none(self) -> None:
        _, publisher, (subscription,) = pair()
        publisher.publish(*"abc")
        subscription.ack(publisher, 3)
        subscription.ack(publisher, 3)
        assert credits(publisher) == [3]
        assert subscription.process.cut_reason is None

    def test_the_slowest_counts(self) -> None:
        _, publisher, (slow, fast) = pair(2)
        publisher.publish(*"abcdefgh")
        fast.ack(publisher, 8)
        assert credits(publisher) == []
        slow.ack(publisher, 2)
        slow.ack(publisher, 7)
        assert credits(publisher) == [2, 7]

    @pytest.mark.parametrize("how", ["endpoint", "process"])
    def test_the_slowest_goes(self, how: str) -> None:
        _, publisher, (slow, fast) = pair(2)
        publisher.publish(*"abcdefgh")
        fast.ack(publisher, 6)
        if how == "endpoint":
            slow.destroy()
        else:
            slow.process.die()
        assert credits(publisher) == [6]

    def test_the_last_one_goes(self) -> None:
        _, publisher, (only,) = pair()
        publisher.publish(*"abc")
        only.destroy()
        assert credits(publisher) == [3]

    def test_a_hung_one_holds_the_publisher_for_the_lease_only(self) -> None:
        world, publisher, (_,) = pair()
        publisher.publish(*"abc")
        for _ in range(11):
            world.advance(1)
            publisher.process.tell(m.Ping())
        assert credits(publisher) == [3]

    def test_one_that_joins_late_is_not_waited_for_in_what_was_before(self) -> None:
        world, publisher, (early,) = pair()
        publisher.publish(*"abc")
        late = world.process().subscription("/topic", ALL)
        early.ack(publisher, 3)
        assert credits(publisher) == [3]
        publisher.publish(*"de")
        early.ack(publisher, 5)
        assert credits(publisher) == [3]
        late.ack(publisher, 4)
        assert credits(publisher) == [3, 4]

    @for_each("seq", [4, 5, 10**12])
    def test_what_was_never_published_cannot_be_acked(self, seq: int) -> None:
        _, publisher, (subscription,) = pair()
        publisher.publish(*"abc")
        subscription.ack(publisher, seq)
        assert (
            subscription.process.cut_reason == f"sample {seq} of publisher 2 acknowledged, the last one is 3"
        )
        assert publisher.process.cut_reason is None

    def test_nobody_is_made_to_ack_what_was_never_published(self) -> None:
        """A run for this subscription alone, with numbers ahead of the samples for all, is a fault."""
        _, publisher, (subscription,) = pair()
        publisher.publish(*"abc")
        publisher.catch_up(subscription, "c", first_seq=3)
        publisher.catch_up(subscription, "d", "e", first_seq=3)
        assert publisher.process.cut_reason == "publisher 2 resent sample 4, the last one is 3"
        assert [one.seq for one in subscription.samples] == [1, 2, 3, 3]
        subscription.ack(publisher, 3)
        assert subscription.process.cut_reason is None

    def test_a_publisher_that_has_gone_may_be_acked(self) -> None:
        _, publisher, (subscription,) = pair()
        publisher.publish(*"abc")
        publisher.destroy()
        subscription.ack(publisher, 3)
        assert subscription.process.cut_reason is None


class TestWhoIsNotWaitedFor:
    @for_each(
        "requested",
        [
            QoSProfile(),
            QoSProfile(reliability="best_effort"),
            QoSProfile(history="keep_all", reliability="best_effort"),
        ],
    )
    def test_others_than_lossless_subscriptions(self, requested: QoSProfile) -> None:
        world = World(LIMITS)
        publisher = world.process().publisher("/topic", ALL)
        listener = world.process()
        listener.subscription("/topic", requested)
        listener.is_blocked = True
        publisher.publish_many(str(at) for at in range(80))
        assert credits(publisher)
        assert credits(publisher)[-1] > 80 - 10

    def test_nobody_listens(self) -> None:
        """The publisher gets credit before the window is full, but not for each sample."""
        publisher = World(LIMITS).process().publisher("/topic", ALL)
        for at in range(1, 301):
            publisher.publish("x")
            assert at - (credits(publisher) or [0])[-1] <= 10
        assert len(credits(publisher)) <= 30

    def test_large_messages_fill_the_window_sooner(self) -> None:
        publisher = World(LIMITS).process().publisher("/topic", ALL)
        for _ in range(10):
            publisher.publish("x" * 2 * KIB)
        assert credits(publisher) == list(range(1, 11))

    def test_publishers_without_a_window_get_no_credit(self) -> None:
        world, publisher, (subscription,) = pair(offered=QoSProfile(depth=100))
        publisher.publish_many("abc")
        subscription.ack(publisher, 3)
        world.advance(1)
        assert credits(publisher) == []
        assert subscription.process.cut_reason is None


class TestLateJoiners:
    KEPT = QoSProfile(history="keep_all", durability="transient_local")

    def test_the_history_may_be_acked_too(self) -> None:
        """A late joiner takes replayed samples like others. Its acknowledgement is no fault, and gives no
        credit.
        """
        world = World(LIMITS)
        publisher = world.process().publisher("/topic", self.KEPT)
        publisher.publish(*"abc")
        late = world.process().subscription("/topic", self.KEPT)
        assert late.payloads == [*"abc"]
        late.ack(publisher, 1)
        late.ack(publisher, 3)
        assert late.process.cut_reason is None
        assert credits(publisher) == []
        publisher.publish("d")
        late.ack(publisher, 4)
        assert credits(publisher) == [4]

    @for_each("known", [2, 3, 9])
    def test_what_was_taken_before_is_credited_when_it_comes_again(self, known: int) -> None:
        """The publisher was known at an earlier busd, and the subscription came back first."""
        world, gid = World(LIMITS), bytes(15) + b"g"
        back = world.process().subscription("/topic", self.KEPT, last_seqs={gid: known})
        publisher = world.process().publisher("/topic", self.KEPT, gid=gid)
        assert credits(publisher) == []
        publisher.publish(*"abc")
        assert credits(publisher) == [min(known, 3)]
        assert [one.seq for one in back.samples] == [*range(known + 1, 4)]
        publisher.publish(*"defghijk")
        back.ack(publisher, 11)
        assert credits(publisher)[-1] == 11


class TestDroppedSamples:
    """A subscription can't take samples that busd has dropped. The publisher must not wait for them for
    ever.
    """

    def test_all_that_waited_expired(self) -> None:
        world, publisher, (subscription,) = pair(offered=QoSProfile(history="keep_all", lifespan=1.0))
        subscription.process.is_blocked = True
        publisher.publish_many("abc")
        world.advance(2.0)
        subscription.process.unblock()
        world.advance(0.1)
        assert subscription.payloads == []
        assert credits(publisher) == [3]

    def test_the_newest_expired_behind_another_publishers(self) -> None:
        world, publisher, (subscription,) = pair(offered=QoSProfile(history="keep_all", lifespan=1.0))
        other = world.process().publisher("/topic", ALL)
        subscription.process.is_blocked = True
        publisher.publish_many("abc")
        other.publish("stays")
        world.advance(2.0)
        subscription.process.unblock()
        world.advance(0.1)
        assert subscription.payloads == ["stays"]
        assert credits(publisher) == [3]
        assert credits(other) == []

    def test_some_expired(self) -> None:
        """The acknowledgement of the remaining sample includes them."""
        world, publisher, (subscription,) = pair(offered=QoSProfile(history="keep_all", lifespan=1.0))
        subscription.process.is_blocked = True
        publisher.publish_many("ab")
        world.advance(0.8)
        publisher.publish("c")
        world.advance(0.8)
        subscription.process.is_blocked = True
        world.carry_out(world.broker.expire(world.now_ns, subscription.process.id))
        world.advance(0.1)
        assert credits(publisher) == []
        subscription.process.unblock()
        assert subscription.payloads == ["c"]
        subscription.ack(publisher, 3)
        assert credits(publisher) == [3]

    def test_one_that_is_too_large(self) -> None:
        world = World(LIMITS, (TopicRule(pattern="/topic", max_message_bytes=KIB),))
        publisher = world.process().publisher("/topic", ALL)
        subscription = world.process().subscription("/topic", ALL)
        publisher.publish("x" * 2 * KIB)
        assert credits(publisher) == [1]
        subscription.process.is_blocked = True
        publisher.publish("still to be taken")
        publisher.publish("x" * 2 * KIB)
        assert credits(publisher) == [1]

    def test_a_gap_of_another_publisher_gives_no_credit(self) -> None:
        world, publisher, _ = pair()
        other = world.process().publisher("/topic")
        publisher.publish_many("abc")
        other.lose(5)
        other.publish("x")
        world.advance(0.1)
        assert credits(publisher) == []

    def test_memory_ran_out(self) -> None:
        limits = Limits(
            keep_all_window_bytes=KIB,
            message_bytes=2 * KIB,
            queued_bytes_per_peer=4 * KIB,
            keep_all_window_messages=80,
        )
        world = World(limits)
        listener = world.process()
        flooded = listener.subscription("/flood", QoSProfile(depth=3))
        subscription = listener.subscription("/topic", ALL)
        flood = world.process().publisher("/flood")
        publisher = world.process().publisher("/topic", ALL)
        listener.is_blocked = True
        for _ in range(4):
            publisher.publish("x" * 240)
        flood.publish("x" * 2000, "x" * 2000)
        assert subscription.statistics(publisher.process).dropped == {"memory_limit": 4}
        assert credits(publisher)[-1] == 4
        listener.unblock()
        publisher.publish("goes on")
        subscription.ack(publisher, 5)
        assert subscription.payloads == ["goes on"]
        assert credits(publisher)[-1] == 5
        assert len(flooded.payloads) == 2

    def test_an_ack_that_comes_after_it(self) -> None:
        world, publisher, (subscription,) = pair(offered=QoSProfile(history="keep_all", lifespan=1.0))
        publisher.publish("in the process")
        subscription.process.is_blocked = True
        publisher.publish("expires")
        world.advance(2.0)
        subscription.process.unblock()
        world.advance(0.1)
        subscription.ack(publisher, 1)
        assert subscription.process.cut_reason is None
        publisher.publish("new")
        subscription.ack(publisher, 3)
        assert credits(publisher)[-1] == 3
