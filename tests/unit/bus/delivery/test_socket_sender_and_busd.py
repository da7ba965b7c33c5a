"""bus.delivery.socket_sender: runs, the window of a keep-all publisher, and samples kept for the next busd.

busd, a talker's and a listener's process are in one event loop (`tests/two_processes.py`).
"""

import asyncio

import pytest

import bus
from accounts_world import TOPIC, Numbered, World
from bus.delivery import allowance, socket_sender
from bus.qos import QoSProfile
from jumping_loop import JumpingLoop
from semantics import KEEP_ALL
from two_processes import LISTENER, TALKER, WINDOW, Play, nodes, restart_busd, two

__all__ = ["two"]

KIB = 1024
by_socket = pytest.mark.parametrize("route", ["socket"], indirect=True)
by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)


async def exchange(
    world: World, publisher: bus.Publisher[Numbered], subscription: bus.Subscription[Numbered], size: int
) -> None:
    """Fill the window, take a quarter of it, fill it again, many times."""
    sent = heard = 0
    for turn in range(20):
        began = sent
        while publisher.publish(Numbered(1, sent, "x" * size)):
            sent += 1
            await world.settle()  # its own run: messages decoded together are taken together
        assert sent > began, f"no room in turn {turn}"
        for _ in range(max(1, (sent - heard) // 4)):
            assert (await subscription.receive())[0].number == heard
            heard += 1
        await world.settle()


@by_socket
@pytest.mark.parametrize("size", [1, 8 * KIB])
def test_nobody_waits_for_a_clock_while_much_is_taken(two: Play, size: int) -> None:
    """The subscription acknowledges an eighth of the window at once, by number or by size, and that part is
    free again.
    """

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        await world.settle()
        loop = asyncio.get_running_loop()
        assert isinstance(loop, JumpingLoop)
        began_s = loop.jumped_s
        await exchange(world, publisher, subscription, size)
        assert loop.jumped_s == began_s

    few = {"keep_all_window_messages": WINDOW} if size == 1 else {"keep_all_window_bytes": 64 * KIB}
    two(story, **few)


@by_shared_memory
def test_samples_that_went_by_the_ring_alone_do_not_fill_the_window(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        near = await listener.create_subscription(Numbered, TOPIC, 1)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        for _ in range(5 * WINDOW):
            assert publisher.publish(Numbered())
        far = world.processes[await world.open_process(shares=False)].node
        distant = await far.create_subscription(Numbered, TOPIC, KEEP_ALL)
        await world.settle()
        for number in range(WINDOW):
            assert publisher.publish(Numbered(1, number))
        assert not publisher.publish(Numbered())
        assert [(await distant.receive())[0].number for _ in range(WINDOW)] == [*range(WINDOW)]
        assert near.statistics().expected == 6 * WINDOW

    two(story)


def test_a_message_above_the_limit_is_refused_and_the_next_one_goes(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        subscription = await listener.create_subscription(Numbered, TOPIC, 10)
        publisher = await talker.create_publisher(Numbered, TOPIC, 10)
        for number in range(3):
            with pytest.raises(bus.PayloadTooLarge, match="limit"):
                publisher.publish(Numbered(1, number, "x" * 2 * KIB))
            publisher.publish(Numbered(1, number))
            assert (await subscription.receive())[0].number == number
        assert publisher.statistics().published == 3

    two(story, message_bytes=2 * KIB, keep_all_window_bytes=2 * KIB)


@by_socket
def test_the_history_that_is_kept_for_the_next_busd_is_bounded(
    two: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket_sender, "STEP_BYTES", 10_000)
    monkeypatch.setattr(socket_sender, "QUEUE_BYTES", 10_000)
    monkeypatch.setattr(allowance, "STEP_BYTES", 10_000)
    qos = QoSProfile(1000, durability="transient_local")

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Numbered, TOPIC, qos)
        for number in range(1000):
            publisher.publish(Numbered(1, number, "x" * 700))
            await asyncio.sleep(0)
        await restart_busd(world, TALKER, LISTENER)
        late = await listener.create_subscription(Numbered, TOPIC, qos)
        await world.settle()
        heard = []
        while taken := late.take():
            heard.append(taken[0].number)
        assert 10 < len(heard) < 200
        assert heard == [*range(1000 - len(heard), 1000)]

    two(story, message_bytes=2 * KIB, keep_all_window_bytes=2 * KIB)
