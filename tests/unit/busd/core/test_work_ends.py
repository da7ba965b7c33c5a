"""Matches that end while the broker is in the middle of long work with them.

Each match ends once, and no process hears of it afterwards.

The broker does the work in pieces, and serves others between two of them.
"""

from collections.abc import Callable

import pytest

from broker_endpoints import Publisher
from broker_world import SECOND, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits

MANY = 40
KEEP_ALL = QoSProfile(history="keep_all")


@pytest.fixture
def world() -> World:
    return World(Limits(matches_per_peer=1 << 20, matches_per_user=1 << 20))


def in_pieces(world: World, action: Callable[[], object], meanwhile: Callable[[], object]) -> None:
    """Do `action` in the smallest pieces, and `meanwhile` after the first of them."""
    acts = [meanwhile]
    world.budget, world.between = 1, lambda: acts.pop()() if acts else None
    action()
    assert not acts, "there was only one piece"
    assert not world.broker.tasks.unfinished


def test_a_subscription_goes_while_its_publisher_does(world: World) -> None:
    listener, talker = world.process(), world.process()
    subscriptions = [listener.subscription("/t") for _ in range(MANY)]
    publisher = talker.publisher("/t")
    in_pieces(world, publisher.destroy, subscriptions[-1].destroy)
    assert not world.whole_graph().matches
    assert [len(one.got(m.Unmatched)) for one in subscriptions] == [1] * MANY
    assert len(talker.got(m.Unmatched)) == MANY


def test_a_publisher_goes_while_its_subscription_does(world: World) -> None:
    listener, talker = world.process(), world.process()
    publishers = [talker.publisher("/t") for _ in range(MANY)]
    subscription = listener.subscription("/t")
    in_pieces(world, subscription.destroy, publishers[-1].destroy)
    assert not world.whole_graph().matches
    assert [len(one.got(m.Unmatched)) for one in publishers] == [1] * MANY
    assert len(listener.got(m.Unmatched)) == MANY


def tick(world: World) -> None:
    """Do one piece of the due work."""
    world.refill()
    world.carry_out(world.broker.tick(world.now_ns))


def test_a_match_that_ends_before_it_is_told_that_its_publisher_lost_its_lease(world: World) -> None:
    many = 200
    listener, talker = world.process(), world.process()
    leased = QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=1.0)
    publisher = talker.publisher("/t", leased)
    subscriptions = [listener.subscription("/t") for _ in range(many)]
    publisher.publish("x")
    world.advance(0)
    before = [one.got(m.LivelinessChanged) for one in subscriptions]
    assert [[told.alive for told in one] for one in before] == [[False, True]] * many
    world.budget, world.now_ns = 1, world.now_ns + SECOND
    while not publisher.got(m.LivelinessLost):
        tick(world)
    told = [one for one in subscriptions if len(one.got(m.LivelinessChanged)) == 3]
    assert 0 < len(told) < many, "there was only one piece"
    gone = next(one for one in subscriptions if one not in told)
    gone.destroy()
    world.advance(0.1)
    assert [len(one.got(m.LivelinessChanged)) for one in subscriptions if one is not gone] == [3] * (many - 1)
    assert len(gone.got(m.LivelinessChanged)) == 2


class TestSilence:
    """Publishers learn that a process is silent, a few at a time."""

    @pytest.fixture(params=[True, False], ids=["memory", "socket"])
    def publishers(self, world: World, request: pytest.FixtureRequest) -> list[Publisher]:
        """Lossless publishers. The first ones have learned that the subscription's process is silent."""
        shares = request.param
        silent, lively = world.process(shares=shares), world.process(shares=shares)
        subscription = silent.subscription("/t", KEEP_ALL)
        publishers = [lively.publisher("/t", KEEP_ALL) for _ in range(MANY)]
        for publisher in publishers:
            if shares:
                subscription.attach(publisher)
        world.now_ns += world.broker._peers[silent.id].lease_ns
        lively.tell(m.Ping())
        world.budget = 1
        while not lively.got(m.Silence):
            tick(world)
        assert 0 < len(lively.got(m.Silence)) < MANY, "there was only one piece"
        self.silent, self.lively = silent, lively
        return publishers

    def test_a_publisher_goes_before_it_is_told(self, world: World, publishers: list[Publisher]) -> None:
        gone = publishers[-1]
        assert not gone.got(m.Silence)
        gone.destroy()
        world.advance(0.1)
        assert [len(one.got(m.Silence)) for one in publishers] == [1] * (MANY - 1) + [0]
        assert not self.silent.cut_reason

    def test_the_silent_one_goes_before_all_are_told(self, world: World, publishers: list[Publisher]) -> None:
        told = len(self.lively.got(m.Silence))
        world.between = lambda: tick(world)
        self.silent.die()
        world.between = lambda: None
        world.advance(0.1)
        assert len(self.lively.got(m.Silence)) == told
        assert [len(one.got(m.Unmatched)) for one in publishers] == [1] * MANY
