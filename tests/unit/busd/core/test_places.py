"""busd.core.places: publishers that keep the place of a lost subscription, and for how long."""

import pytest

from broker_endpoints import Publisher, Subscription
from broker_world import SECOND, Process, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import PLACES
from busd.core import places

ALL = QoSProfile(history="keep_all")
LEASE_S = 10.0


class Story:
    """A publisher that keeps places, and a subscription that loses its connection."""

    def __init__(self, offered: QoSProfile = ALL, requested: QoSProfile = ALL, *, keeps: bool = True) -> None:
        self.world = World()
        self.talker = self.world.process("talker", capabilities=(PLACES,) if keeps else ())
        self.publisher = self.talker.publisher("/topic", offered)
        self.listener = self.world.process("listener")
        self.subscription = self.listener.subscription("/topic", requested)

    def told(self) -> list[tuple[int, bool, float]]:
        """The ends that the publisher was told: the subscription, whether it is lost, and how long to keep
        its place.
        """
        return [(one.other, one.lost, one.keep_s) for one in self.publisher.got(m.Unmatched)]

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds * 2)):
            self.talker.tell(m.Ping())
            self.world.advance(0.5)

    def come_back(self, last_seq: int) -> Subscription:
        known = {self.publisher.gid: last_seq}
        again = self.world.process("listener").node()
        return again.subscription("/topic", ALL, gid=self.subscription.gid, last_seqs=known)


class TestHowLong:
    def test_for_the_lease_while_the_process_lives(self) -> None:
        story = Story()
        story.listener.lose()
        story.live(12)
        assert story.told() == [(story.subscription.id, True, LEASE_S)]

    def test_no_longer_than_the_process_lives(self) -> None:
        story = Story()
        story.listener.die()
        assert story.told() == [(story.subscription.id, True, LEASE_S)], "nobody knows that yet"
        story.world.advance(0.1)
        assert story.told()[1:] == [(story.subscription.id, True, 0)]
        story.live(12)
        assert len(story.told()) == 2

    def test_it_may_end_later(self) -> None:
        story = Story()
        story.listener.lose()
        story.world.advance(1)
        assert len(story.told()) == 1
        story.world.alive.discard(story.listener.pid)
        story.world.advance(1)
        assert story.told()[1:] == [(story.subscription.id, True, 0)]

    def test_what_was_silent_for_the_lease_has_no_place(self) -> None:
        story = Story()
        story.live(12)
        story.listener.lose()
        assert story.told() == [(story.subscription.id, True, 0)]

    def test_nor_has_what_leaves_in_order(self) -> None:
        story = Story()
        story.subscription.destroy()
        assert story.told() == [(story.subscription.id, False, 0)]

    @pytest.mark.parametrize(
        ("offered", "requested", "keeps"),
        [
            (ALL, ALL, False),
            (ALL, QoSProfile(10), True),
            (QoSProfile(10), ALL, True),
            (QoSProfile(history="keep_all", durability="transient_local"), ALL, True),
        ],
        ids=["of an older publisher", "lossy", "of a lossy publisher", "of one with a history"],
    )
    def test_no_place(self, offered: QoSProfile, requested: QoSProfile, keeps: bool) -> None:
        story = Story(offered, requested, keeps=keeps)
        story.listener.lose()
        assert story.told() == [(story.subscription.id, True, 0)]

    def test_publishers_are_not_told_after_their_end(self) -> None:
        story = Story()
        story.listener.die()
        story.publisher.destroy()
        story.world.advance(0.1)
        assert len(story.told()) == 1

    def test_they_are_bounded(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The process that was lost first is the first to lose its places."""
        monkeypatch.setattr(places, "MOST", 2)
        story = Story()
        others = [story.world.process().subscription("/topic", ALL) for _ in range(2)]
        for one in (story.subscription, *others):
            one.process.lose()
        assert [other for other, _, keep_s in story.told() if not keep_s] == [story.subscription.id]
        kept = story.world.broker._registry._places
        assert len(kept) == 2
        story.live(12)
        assert len(kept) == 0


class TestPublishersThatAreLostToo:
    """They are lost before they have repeated the samples that a subscription has missed."""

    def again(self, story: Story, next_seq: int) -> tuple[Process, Publisher]:
        talker = story.world.process("talker", capabilities=(PLACES,))
        return talker, talker.node().publisher("/topic", ALL, gid=story.publisher.gid, next_seq=next_seq)

    def lost(self) -> tuple[Story, Subscription]:
        story = Story()
        story.publisher.publish(*"abcde")
        story.listener.lose()
        back = story.come_back(last_seq=2)
        story.talker.lose()
        return story, back

    def test_what_does_not_come_any_more_is_counted_after_the_lease(self) -> None:
        story, back = self.lost()
        for _ in range(5):
            back.process.tell(m.Ping())
            story.world.advance(1)
        assert back.statistics().dropped == {}
        for _ in range(8):
            back.process.tell(m.Ping())
            story.world.advance(1)
        found = back.statistics()
        assert (found.dropped, found.expected) == ({"disconnected": 3}, 3)
        self.again(story, next_seq=6)
        assert [one.next_seq for one in back.got(m.Matched)] == [3, 6], "it does not come twice"

    def test_one_that_is_back_in_time_repeats_it(self) -> None:
        story, back = self.lost()
        _, publisher = self.again(story, next_seq=6)
        assert [one.last_seq for one in publisher.got(m.Matched)] == [2]
        publisher.catch_up(back, *"cde", first_seq=3)
        for _ in range(13):
            back.process.tell(m.Ping())
            publisher.process.tell(m.Ping())
            story.world.advance(1)
        assert [sample.seq for sample in back.samples] == [3, 4, 5]
        found = back.statistics()
        assert (found.dropped, found.expected) == ({}, 3)

    def test_a_subscription_that_is_back_first_waits_for_it(self) -> None:
        story = Story()
        story.publisher.publish(*"abcde")
        story.listener.lose()
        story.talker.lose()
        back = story.come_back(last_seq=2)
        _, publisher = self.again(story, next_seq=6)
        assert [one.last_seq for one in publisher.got(m.Matched)] == [2]
        publisher.catch_up(back, *"cde", first_seq=3)
        assert [sample.seq for sample in back.samples] == [3, 4, 5]
        assert not any(last_seq for one in back.got(m.Dropped) for _, last_seq in one.missed.values())


def test_a_lease_is_what_the_limits_say() -> None:
    assert World().broker.settings.limits.lease_s * SECOND == LEASE_S * SECOND
