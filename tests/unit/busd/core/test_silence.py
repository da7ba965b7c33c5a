"""busd.core.silence: a process that sends nothing for its lease keeps its place, and no publisher waits for
it.
"""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import SECOND, UID, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.access import Access
from busd.core.limits import Limits

ALL = QoSProfile(history="keep_all")
LEASED = QoSProfile(liveliness_lease_duration=1.0)


def is_silent(process: Process) -> bool:
    return process.world.broker._peers[process.id].is_silent


def pass_time(world: World, seconds: int, *lively: Process) -> None:
    """Pass time while the lively processes give signs of life."""
    for _ in range(seconds):
        world.advance(1)
        for process in lively:
            process.tell(m.Ping())


def credits(publisher: Publisher) -> list[int]:
    return [message.seq for message in publisher.got(m.Credit)]


class TestWhoIsSilent:
    def test_it_keeps_its_place(self) -> None:
        world = World(Limits(lease_s=2.0))
        hung, lively = world.process("hung"), world.process()
        subscription = lively.subscription("/topic")
        publisher = hung.publisher("/topic")
        before = world.whole_graph()
        hung.is_blocked = True
        world.advance(1.0)
        lively.tell(m.Ping())
        world.advance(0.999)
        assert not is_silent(hung)
        lively.tell(m.Ping())
        world.advance(0.001)
        assert is_silent(hung)
        assert not is_silent(lively)
        said = "no sign of life from hung (pid 100) for 2.0 s"
        told = "it keeps its place, and publishers that wait for it continue without it"
        assert world.notes == [f"{said}: {told}"]
        pass_time(world, 3600, lively)
        assert hung.cut_reason is None
        assert world.whole_graph() == before
        assert not subscription.got(m.Unmatched)
        assert len(world.notes) == 1, "said once"
        hung.unblock()
        publisher.publish("x")
        assert subscription.payloads == ["x"]
        assert not is_silent(hung)
        heard = "hung (pid 100) is heard again, after 3602.0 s: publishers wait for it again"
        assert world.notes[1:] == [heard]

    def test_each_by_its_own_lease(self) -> None:
        """Leases of earlier limits count, too, in any order of the signs of life."""
        world = World(Limits(lease_s=4.0))
        slow, talkative = world.process("slow"), world.process("talkative")
        world.broker.reconfigure(world.now_ns, Limits(lease_s=1.0), (), Access(UID, ()))
        quick = world.process("quick")
        for _ in range(2):
            world.advance(0.9)
            quick.tell(m.Ping())
        talkative.tell(m.Ping())
        world.advance(0.999)
        assert not is_silent(quick)
        world.advance(0.001)
        assert is_silent(quick)
        world.advance(1.199)
        assert not is_silent(slow)
        world.advance(0.001)
        assert is_silent(slow)
        world.advance(1.799)
        assert not is_silent(talkative)
        world.advance(0.001)
        assert is_silent(talkative)
        assert len(world.broker.timers._heap) == 1

    @pytest.mark.parametrize("sign", ["ping", "sample"])
    def test_anything_is_a_sign_of_life(self, sign: str) -> None:
        world = World(Limits(lease_s=2.0))
        process = world.process()
        publisher = process.publisher("/topic")
        for _ in range(2):  # the second time, the process was silent before
            for _ in range(20):
                if sign == "ping":
                    process.tell(m.Ping())
                else:
                    publisher.publish("x")
                world.advance(1.9)
                assert not is_silent(process)
            world.advance(0.1)
            assert is_silent(process)

    def test_what_it_takes_is_a_sign_too(self) -> None:
        """The shell may not notice that the process reads, because it reads too little."""
        world = World(Limits(lease_s=2.0))
        process = world.process()
        world.advance(2)
        assert is_silent(process)
        world.carry_out(world.broker.note_alive(world.now_ns, process.id))
        assert not is_silent(process)

    def test_an_idle_broker_is_woken_once_a_lease(self) -> None:
        world = World(Limits(lease_s=2.0))
        process = world.process()
        process.publisher("/topic", QoSProfile(liveliness_lease_duration=100.0))
        wakes = 0
        end_ns = world.now_ns + 20 * SECOND
        while (due_ns := world.broker.next_deadline_ns()) is not None and due_ns <= end_ns:
            world.advance((due_ns - world.now_ns) / SECOND)
            process.tell(m.Ping())
            wakes += 1
        assert wakes <= 20

    def test_a_lease_that_somebody_asked_for_ends_all_the_same(self) -> None:
        world = World()
        hung, lively = world.process(), world.process()
        publisher, subscription = hung.publisher("/topic", LEASED), lively.subscription("/topic", LEASED)
        pass_time(world, 20, lively)
        assert [told.alive for told in subscription.got(m.LivelinessChanged)] == [False]
        publisher.process.tell(m.Ping())
        assert [told.alive for told in subscription.got(m.LivelinessChanged)] == [False, True]


class TestWhoWaits:
    """A lossless publisher, and a subscription with a process that falls silent."""

    @pytest.fixture
    def world(self) -> World:
        return World()

    def pair(self, world: World, *, shares: bool) -> tuple[Publisher, Subscription]:
        publisher = world.process(shares=shares).publisher("/topic", ALL)
        subscription = world.process(shares=shares).subscription("/topic", ALL)
        if shares:
            subscription.attach(publisher)
        return publisher, subscription

    @pytest.mark.parametrize("shares", [False, True], ids=["socket", "shm"])
    def test_it_is_told(self, world: World, shares: bool) -> None:
        publisher, subscription = self.pair(world, shares=shares)
        begun = m.Silence(publisher=publisher.id, subscription=subscription.id, silent_s=10.0)
        over = m.Silence(publisher=publisher.id, subscription=subscription.id, silent_s=13.0, is_over=True)
        pass_time(world, 9, publisher.process)
        assert publisher.got(m.Silence) == []
        pass_time(world, 4, publisher.process)
        assert publisher.got(m.Silence) == [begun]
        subscription.process.tell(m.Ping())
        assert publisher.got(m.Silence) == [begun, over]
        assert not publisher.got(m.Unmatched)

    def test_by_socket_its_credit_goes_on(self, world: World) -> None:
        publisher, subscription = self.pair(world, shares=False)
        subscription.process.is_blocked = True
        publisher.publish(*"abc")
        pass_time(world, 9, publisher.process)
        assert credits(publisher) == []
        pass_time(world, 2, publisher.process)
        assert credits(publisher) == [3]
        publisher.publish_many(str(at) for at in range(20_000))
        assert credits(publisher)[-1] > 3 + 8_000, "nobody waits"
        subscription.process.unblock()
        subscription.ack(publisher, 3)
        assert len(subscription.payloads) == 20_003, "and nothing is lost, where there is room"
        before = len(credits(publisher))
        publisher.publish(*"de")
        assert len(credits(publisher)) == before, "it waits again"
        subscription.ack(publisher, publisher.next_seq - 1)
        assert credits(publisher)[-1] == publisher.next_seq - 1

    def test_others_still_hold_it_back(self, world: World) -> None:
        publisher, silent = self.pair(world, shares=False)
        slow = world.process().subscription("/topic", ALL)
        publisher.publish(*"abcdef")
        slow.ack(publisher, 2)
        pass_time(world, 11, publisher.process, slow.process)
        assert credits(publisher) == [2]
        slow.ack(publisher, 5)
        assert credits(publisher) == [2, 5]
        silent.process.tell(m.Ping())
        publisher.publish("g")
        slow.ack(publisher, 7)
        assert credits(publisher) == [2, 5, 6]

    @pytest.mark.parametrize("shares", [False, True], ids=["socket", "shm"])
    def test_one_that_comes_meanwhile_does_not_wait(self, world: World, shares: bool) -> None:
        _, subscription = self.pair(world, shares=shares)
        world.advance(12)
        late = world.process(shares=shares).publisher("/topic", ALL)
        kinds = [type(told) for told in late.process.messages if isinstance(told, m.Matched | m.Silence)]
        assert kinds == [m.Matched, m.Silence], "in this order"
        late.publish(*"abc")
        pass_time(world, 1, late.process)
        assert (late.id in world.broker.graph.publishers[late.id].awaited) is False
        assert not world.broker.graph.publishers[late.id].awaited
        subscription.process.tell(m.Ping())
        assert late.got(m.Silence)[-1].is_over
        assert bool(world.broker.graph.publishers[late.id].awaited) is not shares

    def test_who_is_not_held_back_is_not_told(self, world: World) -> None:
        silent, lively = world.process(), world.process()
        silent.subscription("/topic", ALL)
        silent.subscription("/topic")
        publisher = lively.publisher("/topic")
        silent.publisher("/back", ALL)
        lively.subscription("/back", ALL)
        pass_time(world, 12, lively)
        silent.tell(m.Ping())
        assert publisher.process.got(m.Silence) == []

    def test_a_process_is_not_told_of_itself(self, world: World) -> None:
        process = world.process()
        publisher, subscription = process.publisher("/topic", ALL), process.subscription("/topic", ALL)
        publisher.publish("a")
        world.advance(12)
        process.tell(m.Ping())
        assert process.got(m.Silence) == []
        publisher.publish("b")
        before = credits(publisher)
        subscription.ack(publisher, 2)
        assert credits(publisher) == [*before, 2]

    def test_the_silent_one_dies(self, world: World) -> None:
        publisher, subscription = self.pair(world, shares=True)
        pass_time(world, 12, publisher.process)
        subscription.process.die()
        assert publisher.got(m.Unmatched) == [
            m.Unmatched(endpoint=publisher.id, other=subscription.id, lost=True)
        ]

    def test_it_goes_by_socket_meanwhile(self, world: World) -> None:
        """The publisher's end refuses to share. Afterwards, it waits for the subscription as before."""
        publisher, subscription = self.pair(world, shares=True)
        publisher.publish("a")
        pass_time(world, 12, publisher.process)
        subscription.process.is_blocked = True
        publisher.refuse(subscription)
        publisher.publish("b")
        assert not world.broker.graph.publishers[publisher.id].awaited
        subscription.process.unblock()
        subscription.process.tell(m.Ping())
        assert subscription.id in world.broker.graph.publishers[publisher.id].awaited

    def test_many_are_told_in_pieces(self, world: World) -> None:
        silent, lively = world.process(), world.process()
        subscriptions = [silent.subscription(f"/t{at}", ALL) for at in range(100)]
        for at in range(100):
            lively.publisher(f"/t{at}", ALL)
        pass_time(world, 9, lively)
        world.budget, world.overdrawn = 40, 0
        pass_time(world, 1, lively)
        assert len(lively.got(m.Silence)) == 100
        silent.tell(m.Ping())
        world.advance(0)
        told = lively.got(m.Silence)
        assert [one.subscription for one in told[100:]] == [one.id for one in subscriptions]
        assert all(one.is_over for one in told[100:])
        assert world.overdrawn <= 80

    def test_it_is_heard_before_all_are_told(self, world: World) -> None:
        """The last state that they are told is true."""
        silent, lively = world.process(), world.process()
        ends = []
        for at in range(100):
            ends.append((silent.subscription(f"/t{at}", ALL), lively.publisher(f"/t{at}", ALL)))
            ends[at][1].publish("x")
        pass_time(world, 9, lively)
        world.budget = 1
        world.now_ns += SECOND
        world.refill()
        world.carry_out(world.broker.tick(world.now_ns))
        assert 0 < len(lively.got(m.Silence)) < 100
        silent.tell(m.Ping())
        pass_time(world, 1, lively)
        last = {one.publisher: one.is_over for one in lively.got(m.Silence)}
        assert list(last.values()) == [True] * 100
        assert all(one.awaited for one in world.broker.graph.publishers.values())
        told = {publisher.id: credits(publisher) for _, publisher in ends}
        for subscription, publisher in ends:
            subscription.ack(publisher, 1)
        assert {publisher.id: credits(publisher) for _, publisher in ends} == {number: [1] for number in told}
        assert 0 < sum(bool(seqs) for seqs in told.values()) < 100


class TestOlderPrograms:
    """A program that does not know Silence would wait for ever by shared memory."""

    def older(self, world: World) -> Process:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("broker_world.SILENCE", "something else")
            return world.process("older", shares=True)

    def test_who_it_waits_for_is_cut_off(self) -> None:
        world = World()
        publisher = self.older(world).publisher("/topic", ALL)
        subscription = world.process("hung", shares=True).subscription("/topic", ALL)
        subscription.attach(publisher)
        pass_time(world, 10, publisher.process)
        assert subscription.process.cut_reason == "no sign of life for 10.0 s"
        assert publisher.got(m.Unmatched) and not publisher.got(m.Silence)
        assert "cut off hung (pid 101): no sign of life for 10.0 s" in world.notes

    def test_one_that_comes_meanwhile_goes_by_socket(self) -> None:
        world = World()
        subscription = world.process(shares=True).subscription("/topic", ALL)
        world.advance(12)
        publisher = self.older(world).publisher("/topic", ALL)
        assert [told.route for told in publisher.got(m.Matched)] == ["socket"]
        publisher.publish_many("x" for _ in range(20_000))
        assert credits(publisher)
        assert subscription.process.cut_reason is None

    def test_a_subscription_of_it(self) -> None:
        world = World()
        subscription = self.older(world).subscription("/topic", ALL)
        publisher = world.process(shares=True).publisher("/topic", ALL)
        subscription.attach(publisher)
        pass_time(world, 11, publisher.process)
        assert subscription.process.cut_reason is None
        assert [told.is_over for told in publisher.got(m.Silence)] == [False]
