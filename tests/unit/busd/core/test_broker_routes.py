"""busd.core.shm_routes: the matches by shared memory, the messages to both ends, and refusals."""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_line import Pair, note, route
from broker_world import ALL_MAY, UID, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from rows import for_each


@pytest.mark.parametrize("publisher_first", [True, False])
class TestMatching:
    def test_both_are_told(self, publisher_first: bool) -> None:
        pair = Pair(publisher_first=publisher_first)
        publisher, subscription = pair.match()
        (told,) = publisher.got(m.Matched)
        assert (told.route, told.at_ns, told.descriptors) == ("shm", pair.world.now_ns, 0)
        (heard,) = subscription.got(m.Matched)
        assert (heard.route, heard.at_ns, heard.descriptors) == ("shm", pair.world.now_ns, 2)
        assert pair.listener.carried == [(heard, [publisher.ring, f"doorbell {pair.talker.id}"])]
        assert route(publisher, subscription) == "shm"

    def test_samples_do_not_pass_through_the_broker(self, publisher_first: bool) -> None:
        pair = Pair(publisher_first=publisher_first)
        plain = pair.world.process().subscription("/topic")
        pair.publisher.publish("a", "b")
        assert plain.payloads == ["a", "b"]
        assert pair.subscription.payloads == []
        assert pair.subscription.statistics().queued == 0

    @pytest.mark.parametrize("who", ["nobody", "talker", "listener"])
    def test_both_must_share(self, publisher_first: bool, who: str) -> None:
        world = World()
        talker = world.process(shares=who == "talker")
        listener = world.process(shares=who == "listener")
        if publisher_first:
            publisher = talker.publisher("/topic")
        subscription = listener.subscription("/topic")
        if not publisher_first:
            publisher = talker.publisher("/topic")
        for end in (publisher, subscription):
            assert [(one.route, one.descriptors) for one in end.got(m.Matched)] == [("socket", 0)]
        publisher.publish("a")
        assert subscription.payloads == ["a"]
        assert route(publisher, subscription) == "socket"

    def test_users_do_not_share(self, publisher_first: bool) -> None:
        world = World(access=(ALL_MAY,))
        talker = world.process(shares=True)
        listener = world.process(shares=True, uid=UID + 1)
        if publisher_first:
            publisher = talker.publisher("/topic")
        subscription = listener.subscription("/topic")
        if not publisher_first:
            publisher = talker.publisher("/topic")
        publisher.publish("a")
        assert subscription.payloads == ["a"]
        assert not listener.carried and not talker.carried


class TestWhoShares:
    def test_a_publisher_without_a_ring(self) -> None:
        world = World()
        publisher = world.process(shares=True).publisher("/topic", ring=False)
        subscription = world.process(shares=True).subscription("/topic")
        assert route(publisher, subscription) == "socket"

    def test_a_ring_without_a_doorbell(self) -> None:
        world = World()
        publisher = world.process().publisher("/topic", ring=True)
        subscription = world.process(shares=True).subscription("/topic")
        assert route(publisher, subscription) == "socket"

    def test_a_process_that_hears_itself(self) -> None:
        process = World().process(shares=True)
        publisher, subscription = process.publisher("/topic"), process.subscription("/topic")
        assert route(publisher, subscription) == "shm"

    def test_shared_once(self) -> None:
        process = World().process(shares=True)
        process.share()
        assert process.cut_reason == "a Share came a second time"

    def test_what_was_shared_was_lost(self) -> None:
        world = World()
        listener = world.process("listener")
        listener.tell(m.Share())
        publisher = world.process(shares=True).publisher("/topic")
        subscription = listener.subscription("/topic")
        assert route(publisher, subscription) == "socket"
        assert note(world, "listener (pid 100) shares no memory: its descriptors were lost")

    def test_the_ring_was_lost(self) -> None:
        world = World()
        talker = world.process(shares=True)
        subscription = world.process(shares=True).subscription("/topic")
        node = talker.node("talker")
        message = m.CreatePublisher(
            request=0,
            node=node.id,
            topic="/topic",
            type_name="T",
            type_hash="h",
            qos=QoSProfile(),
            gid=bytes(16),
            descriptors=1,
        )
        talker.declare_type(("T", "h"))
        talker.request(message, m.Created)
        assert note(world, "/talker shares no memory on '/topic': its ring was lost")
        assert not subscription.got(m.RingReplaced)


class TestAttaching:
    def test_the_publisher_is_told(self) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        subscription.attach(publisher, slot=7)
        told = m.Attached(
            publisher=publisher.id,
            subscription=subscription.id,
            slot=7,
            process=pair.listener.id,
            pid=101,
        )
        assert pair.talker.carried == [
            (told, [f"readers {pair.listener.id}", f"doorbell {pair.listener.id}"])
        ]

    def test_once(self) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        subscription.attach(publisher)
        subscription.attach(publisher)
        assert pair.listener.cut_reason == (
            f"subscription {subscription.id} attached to publisher {publisher.id} a second time"
        )
        assert publisher.got(m.Unmatched) and pair.talker.cut_reason is None

    @for_each("how", ["unmatched", "never matched", "never there", "socket", "refused"])
    def test_too_late(self, how: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        match how:
            case "unmatched":
                publisher.destroy()
            case "never matched":
                publisher = pair.talker.publisher("/other")
            case "never there":
                publisher.id += 1000  # type: ignore[assignment]
            case "socket":
                publisher = pair.world.process().publisher("/topic")
            case "refused":
                publisher.refuse(subscription)
        subscription.attach(publisher)
        assert pair.listener.cut_reason is None
        assert not pair.talker.got(m.Attached)

    def test_with_a_subscription_of_another(self) -> None:
        pair = Pair()
        pair.talker.tell(m.Attach(subscription=pair.subscription.id, source=pair.publisher.id, slot=0))
        assert pair.talker.cut_reason == f"endpoint {pair.subscription.id} is not one of yours"

    def test_with_a_publisher(self) -> None:
        pair = Pair()
        pair.talker.tell(m.Attach(subscription=pair.publisher.id, source=pair.publisher.id, slot=0))
        assert pair.talker.cut_reason == f"endpoint {pair.publisher.id} is not a subscription"


def refuse(who: str, publisher: Publisher, subscription: Subscription, text: str = "no memory") -> None:
    if who == "talker":
        publisher.refuse(subscription, text)
    else:
        subscription.refuse(publisher, text)


@pytest.mark.parametrize("who", ["talker", "listener"])
class TestRefusing:
    @pytest.mark.parametrize("is_attached", [True, False])
    def test_both_are_told_and_the_socket_takes_over(self, who: str, is_attached: bool) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        matched_ns = pair.world.now_ns
        if is_attached:
            subscription.attach(publisher)
        pair.world.advance(0.5)
        pair.listener.has_read = 37
        refuse(who, publisher, subscription)
        told = m.Rerouted(endpoint=subscription.id, other=publisher.id, route="socket", at_ns=matched_ns)
        assert subscription.got(m.Rerouted) == [told]
        told = m.Rerouted(
            endpoint=publisher.id, other=subscription.id, route="socket", at_ns=matched_ns, last_seq=37
        )
        assert publisher.got(m.Rerouted) == [told]
        assert route(publisher, subscription) == "socket"
        publisher.catch_up(subscription, "x", "y", first_seq=38)
        publisher.resume(40)
        publisher.publish("a")
        publisher.publish("b")
        numbers = [(one.seq, one.payload) for one in subscription.samples]
        assert numbers == [(38, "x"), (39, "y"), (40, "a"), (41, "b")]
        assert subscription.statistics().dropped == {}
        refusing = pair.talker if who == "talker" else pair.listener
        assert pair.world.notes[-1].endswith(f"go by socket: {who} (pid {99 + refusing.id}): no memory")

    def test_the_others_stay(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        other = pair.world.process(shares=True).subscription("/topic")
        refuse(who, publisher, subscription)
        assert route(publisher, other) == "shm"
        publisher.catch_up(subscription)
        publisher.publish("a")
        assert (subscription.payloads, other.payloads) == (["a"], [])

    def test_said_again(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        for again in ("talker", "listener", who):
            refuse(again, publisher, subscription)
        assert len(publisher.got(m.Rerouted)) == len(subscription.got(m.Rerouted)) == 1
        assert len([one for one in pair.world.notes if "go by socket" in one]) == 1
        publisher.catch_up(subscription)
        publisher.publish("a")
        assert subscription.payloads == ["a"]

    def test_a_match_that_has_just_gone(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        (subscription if who == "talker" else publisher).destroy()
        refuse(who, publisher, subscription)
        assert pair.talker.cut_reason is None and pair.listener.cut_reason is None

    def test_for_another(self, who: str) -> None:
        pair = Pair()
        stranger = pair.world.process()
        endpoint = pair.publisher if who == "talker" else pair.subscription
        stranger.tell(m.RefuseRoute(endpoint=endpoint.id, other=1, text="no"))
        assert stranger.cut_reason == f"endpoint {endpoint.id} is not one of yours"
        assert route(*pair.match()) == "shm"

    def test_observers_see_one_change(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        watcher = pair.world.process()
        watcher.request(m.Observe(request=0), m.GraphSnapshot)
        refuse(who, publisher, subscription)
        (change,) = watcher.got(m.GraphChanged)
        ends = {"publisher": publisher.id, "subscription": subscription.id}
        assert change.matches_removed == (m.MatchRecord(**ends, route="shm"),)
        assert change.matches_added == (m.MatchRecord(**ends, route="socket"),)

    def test_the_publisher_goes_on_as_long_as_the_ring_is_read(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        pair.listener.is_blocked = True
        refuse(who, publisher, subscription)
        assert publisher.got(m.Rerouted) == []
        publisher.catch_up(subscription, "too early")
        publisher.publish("2")
        pair.listener.unblock()
        assert len(publisher.got(m.Rerouted)) == 1
        assert subscription.samples == []
        assert subscription.statistics().expected == 0

    def test_it_leaves_twice_or_without_being_asked(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        left = m.LeaveRing(subscription=subscription.id, source=publisher.id, seq=7)
        pair.listener.tell(left)
        refuse(who, publisher, subscription)
        pair.listener.tell(left)
        assert [told.last_seq for told in publisher.got(m.Rerouted)] == [0]
        pair.listener.tell(m.LeaveRing(subscription=subscription.id, source=99))
        assert pair.listener.cut_reason is None
        pair.talker.tell(left)
        assert pair.talker.cut_reason == f"endpoint {subscription.id} is not one of yours"

    def test_what_came_alone_does_not_come_again_with_what_goes_to_all(self, who: str) -> None:
        """Samples of it that the publisher's own queue replaced are no loss for this subscription either."""
        pair = Pair()
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic")
        refuse(who, publisher, subscription)
        publisher.catch_up(subscription, *"12345")
        publisher.lose(3)
        publisher.publish("4", "5")
        publisher.publish("6")
        assert subscription.payloads == [*"123456"]
        assert plain.payloads == [*"456"]
        totals, others = subscription.statistics(), plain.statistics()
        assert (totals.expected, totals.dropped) == (6, {})
        assert (others.expected, others.dropped) == (6, {"publisher_queue": 3})

    def test_samples_before_the_publisher_knows(self, who: str) -> None:
        """The other subscription got them by socket. This one gets all of them in order, in a run for it
        alone.
        """
        pair = Pair()
        publisher, subscription = pair.match()
        plain = pair.world.process().subscription("/topic")
        publisher.publish("1")
        refuse(who, publisher, subscription)
        publisher.publish("2")
        assert (plain.payloads, subscription.payloads) == (["1", "2"], [])
        publisher.catch_up(subscription, "1", "2")
        publisher.publish("3")
        assert plain.payloads == subscription.payloads == ["1", "2", "3"]
        assert publisher.statistics().samples == 3

    def test_catching_up_with_one_that_has_left(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        refuse(who, publisher, subscription)
        subscription.destroy()
        publisher.catch_up(subscription, "1")
        assert pair.talker.cut_reason is None
        assert pair.talker.graph().matches == ()

    def test_catching_up_with_one_that_reads_the_ring(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        publisher.catch_up(subscription, "1")
        publisher.publish("1")
        assert subscription.payloads == []
        assert route(publisher, subscription) == "shm"

    def test_catching_up_for_another_s_publisher(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        refuse(who, publisher, subscription)
        pair.listener.tell(m.CaughtUp(publisher=publisher.id, subscription=subscription.id))
        assert pair.listener.cut_reason == f"endpoint {publisher.id} is not one of yours"

    def test_catching_up_with_what_is_too_large(self, who: str) -> None:
        pair = Pair()
        publisher, subscription = pair.match()
        refuse(who, publisher, subscription)
        pair.world.broker.graph.publishers[publisher.id].max_message_bytes = 10
        publisher.catch_up(subscription, "x" * 11)
        assert subscription.payloads == []
        assert subscription.statistics().dropped == {"too_large": 1}
