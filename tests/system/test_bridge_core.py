"""Two buses and what crosses between them, over an engine without a network."""

from collections.abc import Callable
from typing import Any

import bus
from bridging import world
from bus.msg.std_msgs import String

__all__ = ["world"]

Made = Callable[[], Any]


async def received(subscription: bus.Subscription[Any], number: int) -> list[str]:
    return [(await subscription.receive())[0].data for _ in range(number)]


async def test_a_talker_is_heard_on_the_other_bus(world: Made) -> None:
    async with world() as made:
        left, right, *_ = await made.pair()
        talker, listener = await left.node("talker"), await right.node("listener")
        publisher = await talker.create_publisher(String, "chatter")
        subscription = await listener.create_subscription(String, "chatter")
        await publisher.wait_for_subscriptions()
        await subscription.wait_for_publishers()
        for number in range(3):
            publisher.publish(String(data=str(number)))
        assert await received(subscription, 3) == ["0", "1", "2"]
