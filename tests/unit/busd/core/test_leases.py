"""busd.core.leases: publishers with an expired lease, and the processes that learn of it."""

from broker_endpoints import Publisher, Subscription
from broker_world import Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m

AUTOMATIC = QoSProfile(liveliness_lease_duration=1.0)
MANUAL = QoSProfile(liveliness_lease_duration=1.0, liveliness="manual_by_topic")


class Watch:
    """A talker with publishers that have a lease of one second, and a listener that stays alive."""

    def __init__(self, offered: QoSProfile) -> None:
        self.world = World()
        self.talker: Process = self.world.process("talker")
        self.listener: Process = self.world.process("listener")
        self.node = self.talker.node("talker")
        self.publisher: Publisher = self.node.publisher("/topic", offered)
        self.subscription: Subscription = self.listener.subscription(
            "/topic", QoSProfile(liveliness_lease_duration=offered.liveliness_lease_duration)
        )

    def lost(self) -> int:
        """How many times the publisher learned that its lease ended."""
        return len(self.publisher.got(m.LivelinessLost))

    def seen(self, subscription: Subscription | None = None) -> list[bool]:
        """The states of the publisher that the subscription was told."""
        told = (subscription or self.subscription).got(m.LivelinessChanged)
        assert all(change.publisher == self.publisher.id for change in told)
        return [change.alive for change in told]


class TestAutomatic:
    def test_a_silent_process_is_not_alive(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.world.advance(0.999)
        assert (watch.lost(), watch.seen()) == (0, [])
        watch.world.advance(0.001)
        assert (watch.lost(), watch.seen()) == (1, [False])
        assert "/talker lost its liveliness on '/topic'" in watch.world.notes

    def test_it_is_told_once(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.world.advance(5)
        assert (watch.lost(), watch.seen()) == (1, [False])

    def test_any_sign_of_the_process_counts(self) -> None:
        watch = Watch(AUTOMATIC)
        other = watch.talker.publisher("/other")
        for at in range(10):
            watch.world.advance(0.9)
            if at % 2:
                watch.talker.tell(m.Ping())
            else:
                other.publish("x")
        assert (watch.lost(), watch.seen()) == (0, [])

    def test_it_comes_back(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.world.advance(1)
        watch.talker.tell(m.Ping())
        assert watch.seen() == [False, True]
        watch.world.advance(0.9)
        assert watch.seen() == [False, True]
        watch.world.advance(0.1)
        assert watch.seen() == [False, True, False]
        assert watch.lost() == 2

    def test_a_sample_brings_it_back_too(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.world.advance(1)
        watch.publisher.publish("x")
        assert watch.seen() == [False, True]
        assert watch.subscription.payloads == ["x"]

    def test_so_does_a_sample_of_another_publisher_of_the_process(self) -> None:
        watch = Watch(AUTOMATIC)
        other = watch.talker.publisher("/other")
        watch.world.advance(1)
        other.publish("x")
        assert watch.seen() == [False, True]

    def test_its_samples_are_delivered_all_the_same(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.listener.is_blocked = True
        watch.publisher.publish("x")
        watch.world.advance(2)
        watch.listener.unblock()
        assert watch.subscription.payloads == ["x"]


class TestManual:
    def test_signs_of_the_process_do_not_count(self) -> None:
        watch = Watch(MANUAL)
        other = watch.node.publisher("/other", MANUAL)
        watch.publisher.publish("x")
        watch.world.advance(0.9)
        watch.talker.tell(m.Ping())
        other.publish("x")
        watch.talker.tell(m.AssertLiveliness(publisher=other.id))
        watch.world.advance(0.1)
        assert (watch.lost(), watch.seen()) == (1, [False, True, False])
        assert other.got(m.LivelinessLost) == []

    def test_publishing_and_asserting_count(self) -> None:
        watch = Watch(MANUAL)
        for at in range(10):
            watch.world.advance(0.9)
            if at % 2:
                watch.publisher.publish("x")
            else:
                watch.talker.tell(m.AssertLiveliness(publisher=watch.publisher.id))
        assert (watch.lost(), watch.seen()) == (0, [False, True])

    def test_it_comes_back_by_its_own_sign_only(self) -> None:
        watch = Watch(MANUAL)
        watch.publisher.publish("x")
        watch.world.advance(1)
        watch.talker.tell(m.Ping())
        assert watch.seen() == [False, True, False]
        watch.talker.tell(m.AssertLiveliness(publisher=watch.publisher.id))
        assert watch.seen() == [False, True, False, True]
        watch.world.advance(1)
        assert watch.seen() == [False, True, False, True, False]

    def test_it_is_not_alive_before_its_first_sign(self) -> None:
        watch = Watch(MANUAL)
        (matched,) = watch.subscription.got(m.Matched)
        assert matched.awaits_sign
        assert watch.seen() == [False], "for older libraries"
        watch.world.advance(5)
        assert (watch.lost(), watch.seen()) == (0, [False])
        watch.talker.tell(m.AssertLiveliness(publisher=watch.publisher.id))
        assert watch.seen() == [False, True]
        watch.world.advance(1)
        assert (watch.lost(), watch.seen()) == (1, [False, True, False])

    def test_a_later_subscription_learns_of_the_next_sign(self) -> None:
        watch = Watch(MANUAL)
        watch.publisher.publish("x")
        late = watch.listener.subscription("/topic", AUTOMATIC)
        gone = watch.listener.subscription("/topic", AUTOMATIC)
        gone.destroy()
        assert late.got(m.Matched)[0].awaits_sign
        watch.world.advance(0.5)
        assert watch.seen(late) == []
        watch.publisher.publish("x")
        assert (watch.seen(), watch.seen(late), watch.seen(gone)) == ([False, True], [True], [])
        watch.publisher.publish("x")
        assert (watch.seen(), watch.seen(late)) == ([False, True], [True]), "once"
        watch.world.advance(1)
        assert (watch.seen(), watch.seen(late)) == ([False, True, False], [True, False])

    def test_busd_forgets_the_matches_that_wait_for_a_sign(self) -> None:
        watch = Watch(MANUAL)
        watch.publisher.publish("x")
        (entity,) = watch.world.broker.graph.topics["/topic"].publishers.values()
        for _ in range(3):
            late = watch.listener.subscription("/topic", AUTOMATIC)
            assert len(entity.unaware) == 1
            late.destroy()
            assert not entity.unaware
        watch.listener.subscription("/topic")
        assert not entity.unaware, "without a lease it does not wait"
        watch.listener.subscription("/topic", AUTOMATIC)
        watch.world.advance(1)
        assert not entity.unaware, "the next sign reaches all"

    def test_asserting_what_has_no_lease_does_nothing(self) -> None:
        watch = Watch(QoSProfile(liveliness="manual_by_topic"))
        watch.talker.tell(m.AssertLiveliness(publisher=watch.publisher.id))
        for _ in range(8):
            watch.world.advance(2)
            watch.talker.tell(m.Ping())
            watch.listener.tell(m.Ping())
        assert (watch.lost(), watch.seen()) == (0, [])


class TestLeases:
    def test_each_publisher_has_its_own(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.listener.subscription("/topic")
        slow = watch.node.publisher("/topic", QoSProfile(liveliness_lease_duration=3.0))
        watch.world.advance(2)
        assert slow.got(m.LivelinessLost) == []
        watch.world.advance(1)
        assert len(slow.got(m.LivelinessLost)) == 1
        told = [one.publisher for one in watch.listener.messages if isinstance(one, m.LivelinessChanged)]
        assert told == [watch.publisher.id, watch.publisher.id, slow.id]

    def test_a_lease_longer_than_the_brokers(self) -> None:
        """The process must give signs of life more often than its publisher."""
        watch = Watch(QoSProfile(liveliness_lease_duration=25.0, liveliness="manual_by_topic"))
        watch.publisher.publish("x")
        for _ in range(24):
            watch.world.advance(1)
            watch.talker.tell(m.Ping())
            watch.listener.tell(m.Ping())
        assert watch.lost() == 0
        watch.world.advance(1)
        assert (watch.lost(), watch.seen()) == (1, [False, True, False])

    def test_a_sign_late_in_a_long_lease(self) -> None:
        watch = Watch(QoSProfile(liveliness_lease_duration=25.0, liveliness="manual_by_topic"))
        watch.publisher.publish("x")
        for second in range(48):
            watch.world.advance(1)
            watch.talker.tell(m.Ping())
            watch.listener.tell(m.Ping())
            if second == 23:
                watch.publisher.publish("x")
        assert watch.lost() == 0
        watch.world.advance(1)
        assert watch.lost() == 1

    def test_a_publisher_that_has_gone_loses_nothing(self) -> None:
        watch = Watch(AUTOMATIC)
        watch.publisher.destroy()
        watch.world.advance(2)
        assert (watch.lost(), watch.seen()) == (0, [])

    def test_one_that_has_lost_it_may_go(self) -> None:
        watch = Watch(MANUAL)
        watch.publisher.publish("x")
        watch.world.advance(1)
        watch.publisher.destroy()
        watch.talker.tell(m.Ping())
        assert watch.seen() == [False, True, False]
        assert watch.subscription.got(m.Unmatched)


class TestWhoIsTold:
    def test_a_subscription_that_comes_later(self) -> None:
        """A subscription that joins while the publisher is not alive must not count it as alive."""
        watch = Watch(AUTOMATIC)
        watch.world.advance(1)
        late = watch.listener.subscription("/topic")
        assert watch.seen(late) == [False]
        kinds = [
            type(one)
            for one in late.process.messages
            if getattr(one, "subscription", getattr(one, "endpoint", 0)) == late.id
        ]
        assert kinds == [m.Matched, m.LivelinessChanged], "in this order"
        watch.talker.tell(m.Ping())
        assert watch.seen(late) == [False, True]

    def test_only_those_that_match(self) -> None:
        watch = Watch(QoSProfile(liveliness_lease_duration=1.0, reliability="best_effort"))
        easy = watch.listener.subscription("/topic", QoSProfile(reliability="best_effort"))
        watch.world.advance(1)
        assert (watch.seen(), watch.seen(easy)) == ([], [False])
