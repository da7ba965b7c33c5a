"""Bounds on the broker's calls for a declaration. See `callcount`."""

import pytest

from broker_world import TEXT, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.effects import Send
from callcount import CallCounter


def calls_of_a_subscription(publishers: int, *, shares: bool) -> int:
    """Calls of Python for a subscription that matches `publishers` publishers of other processes."""
    world = World()
    for _ in range(publishers):
        world.process(shares=shares).publisher("/topic")
    listener = world.process(shares=shares)
    listener.subscription("/another")
    node = listener.graph().nodes[-1]
    message = m.CreateSubscription(
        request=1,
        node=node.id,
        topic="/topic",
        type_name=TEXT[0],
        type_hash=TEXT[1],
        qos=QoSProfile(),
        gid=bytes(16),
        last_seqs={},
    )
    with CallCounter() as counter:
        effects = world.broker.handle(world.now_ns, listener.id, message)
    told = [effect.message for effect in effects if isinstance(effect, Send)]
    assert sum(isinstance(one, m.Matched) for one in told) == 2 * publishers
    return counter.python


@pytest.mark.parametrize(("shares", "most"), [(True, 46), (False, 48)], ids=["memory", "socket"])
def test_calls_of_a_subscription_that_matches_one_publisher(shares: bool, most: int) -> None:
    assert 20 <= calls_of_a_subscription(1, shares=shares) <= most


@pytest.mark.parametrize(("shares", "most"), [(True, 11), (False, 13)], ids=["memory", "socket"])
def test_calls_of_one_more_match(shares: bool, most: int) -> None:
    more = calls_of_a_subscription(11, shares=shares) - calls_of_a_subscription(1, shares=shares)
    assert 5 * 10 <= more <= most * 10
