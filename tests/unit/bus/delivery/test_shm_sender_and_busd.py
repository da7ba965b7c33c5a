"""bus.delivery.shm_sender: the messages that a ring keeps, its growth, and the end of waiting for a
subscription.

busd, a talker's and a listener's process are in one event loop (`tests/two_processes.py`).
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from accounts_cuts import Cuts
from accounts_world import TOPIC, Numbered, World
from bus.delivery import shm_receiver
from bus.qos import QoSProfile
from bus.shm import segments
from semantics import KEEP_ALL
from two_processes import LISTENER, TALKER, Play, nodes, restart_busd, two

__all__ = ["two"]

pytestmark = pytest.mark.parametrize("route", ["shm"], indirect=True)

LONG = "x" * 100_000


class Frame(msgspec.Struct):
    data: bytes = b""


@pytest.fixture
def rings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The sizes of new rings, in their order."""
    made: list[int] = []
    make_ring: Callable[..., Any] = segments.make_ring

    def note(capacity: int, index_length: int, first_seq: int) -> Any:
        made.append(capacity)
        return make_ring(capacity, index_length, first_seq)

    monkeypatch.setattr(segments, "make_ring", note)
    return made


def doorbells() -> int:
    """The number of doorbells that this process has open."""
    found = 0
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found += str(entry.readlink()) == "anon_inode:[eventfd]"
        except OSError:
            continue  # the descriptor that lists the folder
    return found


def test_it_keeps_what_those_need_that_are_there(two: Play, rings: list[int]) -> None:
    """The depth of a subscription that has left does not make the ring larger."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Numbered, TOPIC, 1)
        deep = await listener.create_subscription(Numbered, TOPIC, 5000)
        await world.settle()
        await deep.close()
        await world.settle()
        for number in range(5000):
            publisher.publish(Numbered(1, number, "x" * 400))
        assert max(rings) < 1000 * 400
        deep = await listener.create_subscription(Numbered, TOPIC, 5000)
        await world.settle()
        for number in range(5000):
            publisher.publish(Numbered(1, number, "x" * 400))
        assert rings[-1] > 5000 * 400
        await world.settle()
        assert deep.statistics().dropped == {}

    two(story)


@pytest.mark.parametrize("how", ["closed", "lost"])
def test_nobody_waits_for_a_subscription_that_has_left(two: Play, how: str) -> None:
    """With "lost", busd has lost the subscription and does not know whether its process reads on."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
        await publisher.wait_for_subscriptions()
        while publisher.publish(Numbered(padding=LONG)):
            pass
        sending = asyncio.create_task(publisher.send(Numbered(padding=LONG)))
        await asyncio.sleep(1)
        assert not sending.done()
        if how == "closed":
            await subscription.close()
        else:
            world.processes[LISTENER].gate.clear()
            world.peer(LISTENER).stream._lose(None)
        await asyncio.sleep(1)
        assert sending.done()
        for _ in range(1000):
            assert publisher.publish(Numbered(padding=LONG))
        world.processes[LISTENER].gate.set()

    two(story)


def test_who_waits_for_room_hears_that_the_ring_has_grown(two: Play) -> None:
    """No message was taken, but a longer message needed a larger ring."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
        subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
        await publisher.wait_for_subscriptions()
        number = 0
        while publisher.publish(Numbered(1, number, LONG)):
            number += 1
        sending = asyncio.create_task(publisher.send(Numbered(2, number, LONG)))
        await asyncio.sleep(1)
        assert not sending.done()
        assert publisher.publish(Numbered(3, number, 100 * LONG))
        await asyncio.sleep(1)
        assert sending.done()
        heard = [(await subscription.receive())[0].publisher for _ in range(number + 2)]
        assert heard == [1] * number + [3, 2]

    two(story)


def test_a_reader_is_let_go_once_nothing_of_it_is_held(two: Play) -> None:
    """The subscription has left, and a view of one of its messages lived on."""

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Frame, "/frames", 10)
        # From now on, busd has the process's doorbell.
        await listener.create_subscription(Frame, "/others", 10)
        before = doorbells()
        subscription = await listener.create_subscription(Frame, "/frames", 10, views=True)
        await publisher.wait_for_subscriptions()
        # From the second message on, the process may hold messages in place.
        publisher.publish(Frame(b"first"))
        await subscription.receive()
        publisher.publish(Frame(bytes(50_000)))
        held = (await subscription.receive())[0]
        await subscription.close()
        await asyncio.sleep(5)
        assert doorbells() > before
        assert bytes(held.data) == bytes(50_000)
        del held
        await asyncio.sleep(5)
        assert doorbells() == before

    two(story)


def test_one_that_grows_while_busd_is_told_of_it_is_told_once_more(
    two: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(Numbered, TOPIC, 100)
        subscription = await listener.create_subscription(Numbered, TOPIC, 100)
        await publisher.wait_for_subscriptions()
        declaration = publisher._core.declaration

        def declare_and_grow(request: int, node: int) -> Any:
            asyncio.get_running_loop().call_soon(publisher.publish, Numbered(1, 1, 100 * LONG))
            return declaration(request, node)

        monkeypatch.setattr(publisher._core, "declaration", declare_and_grow)
        publisher.publish(Numbered(1, 0))
        await restart_busd(world, TALKER, LISTENER)
        publisher.publish(Numbered(1, 2))
        await world.settle()
        assert [(await subscription.receive())[0].number for _ in range(3)] == [0, 1, 2]

    two(story)


@pytest.mark.parametrize(("offered", "requested"), [(10, 3), (3, 10), (10, 10)])
def test_one_that_can_not_read_it_gets_as_much_history_as_any_other(
    two: Play, offered: int, requested: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> Any:
        raise OSError(12, "Cannot allocate memory")

    async def story(world: World) -> None:
        talker, listener = nodes(world)
        publisher = await talker.create_publisher(
            Numbered, TOPIC, QoSProfile(offered, durability="transient_local")
        )
        for number in range(20):
            publisher.publish(Numbered(1, number))
        monkeypatch.setattr(shm_receiver.segments, "map_ring", refuse)  # type: ignore[attr-defined]
        qos = QoSProfile(requested, durability="transient_local")
        late = await listener.create_subscription(Numbered, TOPIC, qos)
        await world.settle()
        publisher.publish(Numbered(1, 20))
        await world.settle()
        monkeypatch.undo()
        heard = []
        while taken := late.take():
            heard.append(taken[0].number)
        assert heard == [*range(20 - min(offered, requested), 21)]
        assert late.statistics().dropped == {}

    two(story)


@pytest.mark.parametrize("durability", ["volatile", "transient_local"])
def test_what_a_process_has_published_to_itself_and_not_taken_is_there_when_its_connection_is_back(
    two: Play, durability: str
) -> None:
    """Before that, busd has told the subscription that the publisher left, and its last number."""

    async def story(world: World) -> None:
        node, _ = nodes(world)
        subscription = await node.create_subscription(Numbered, TOPIC, KEEP_ALL)
        publisher = await node.create_publisher(Numbered, TOPIC, QoSProfile(5, durability=durability))
        await publisher.wait_for_subscriptions()
        for number in range(3):
            publisher.publish(Numbered(1, number))
        await world.settle()
        await Cuts(world).cut([TALKER], [])
        publisher.publish(Numbered(1, 3))
        await world.settle()
        found = subscription.statistics()
        assert (found.expected, found.queued, found.dropped) == (4, 4, {})
        assert [(await subscription.receive())[0].number for _ in range(4)] == [0, 1, 2, 3]

    two(story)
