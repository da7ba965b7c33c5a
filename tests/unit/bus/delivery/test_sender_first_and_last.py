"""Samples published before their readers are known, and the samples that a keep-all window lets through."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from accounts_world import TOPIC, Numbered, World
from bus.delivery.ring_size import FIRST_CAPACITY
from bus.qos import QoSProfile
from bus.shm import segments
from semantics import KEEP_ALL
from two_processes import LISTENER, TALKER, WINDOW, Play, nodes, restart_busd, two

__all__ = ["two"]

by_socket = pytest.mark.parametrize("route", ["socket"], indirect=True)


@pytest.mark.parametrize("memory", ["enough", "short"])
def test_all_of_a_new_publisher_is_claimed_also_what_its_first_reader_comes_too_late_for(
    two: Play, memory: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The subscription was matched before the first message. When it learns of the ring, the writer has
    lapped that ring many times.

    Without memory for another ring, this happens to the first ring.
    """

    make_ring: Callable[..., Any] = segments.make_ring

    def make_the_first(capacity: int, *more: int) -> Any:
        if capacity > FIRST_CAPACITY:
            raise OSError(12, "Cannot allocate memory")
        return make_ring(capacity, *more)

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, 10)
        world.block(LISTENER)
        if memory == "short":
            monkeypatch.setattr(segments, "make_ring", make_the_first)
        publisher = await talker.create_publisher(Numbered, TOPIC, 10)
        for number in range(5000):
            publisher.publish(Numbered(1, number))
        await world.unblock_all()
        await asyncio.sleep(1)  # busd reports its drops a moment later
        found = subscription.statistics()
        assert (found.expected, found.queued, sum(found.dropped.values())) == (5000, 10, 4990)
        assert [taken[0].number for _ in range(10) if (taken := subscription.take())] == [*range(4990, 5000)]

    two(story)


@by_socket
def test_a_flood_within_one_turn_stops_at_the_window(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        for _ in range(3):
            taken = [publisher.publish(Numbered()) for _ in range(2 * WINDOW)]
            assert taken == [True] * WINDOW + [False] * WINDOW
            for _ in range(WINDOW):
                await subscription.receive()
            await world.settle()

    two(story)


@by_socket
@pytest.mark.parametrize("durability", ["volatile", "transient_local"])
@pytest.mark.parametrize("order", [(TALKER, LISTENER), (LISTENER, TALKER)], ids=["talker", "listener"])
def test_a_full_window_that_was_taken_holds_up_nobody_when_busd_is_back(
    two: Play, order: tuple[int, int], durability: str
) -> None:
    """The acknowledgement was lost with the old busd, and the subscription will not take these messages
    again.
    """

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        qos = QoSProfile(history="keep_all", durability=durability)
        subscription = await listener.create_subscription(Numbered, TOPIC, qos)
        publisher = await talker.create_publisher(Numbered, TOPIC, qos)
        for number in range(WINDOW):
            assert publisher.publish(Numbered(1, number))
        assert not publisher.publish(Numbered())
        for number in range(WINDOW):
            assert (await subscription.receive())[0].number == number
        await restart_busd(world, *order)
        await asyncio.sleep(100)
        for number in range(5 * WINDOW):
            assert publisher.publish(Numbered(1, number))
            assert (await subscription.receive())[0].number == number
            await asyncio.sleep(1)
        assert subscription.statistics().dropped == {}

    two(story)
