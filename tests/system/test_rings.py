"""A publisher's ring, seen from outside: it grows, keeps its depth, and is read without sleep."""

import asyncio
import random
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bus
from bus.delivery.shm_sender import ShmSender
from bus.msg.std_msgs import Int32
from bus.shm import segments
from semantics import KEEP_ALL, accounted, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)


class Numbered(msgspec.Struct):
    number: int = 0
    data: bytes = b""


def numbered(number: int, size: int) -> Numbered:
    return Numbered(number, number.to_bytes(4, "little") * (size // 4))


@by_shared_memory
async def test_sends_lose_nothing_that_is_read_in_the_same_loop(node: bus.Node) -> None:
    """`send` lets the reader run after each hundred messages, so a depth of some hundreds is enough."""
    heard: list[int] = []
    subscription = await node.create_subscription(
        Int32, "t", 1000, lambda message: heard.append(message.data)
    )
    publisher = await node.create_publisher(Int32, "t", 1000)
    await publisher.wait_for_subscriptions()
    ring = publisher._sender.ring
    assert ring is not None and ring.gates.is_read_here
    for number in range(20_000):
        await publisher.send(Int32(data=number))
    await until(lambda: len(heard) == 20_000)
    assert heard == list(range(20_000))
    await subscription.close()
    await until(lambda: not ring.gates.is_read_here)


class TestGrowth:
    @by_shared_memory
    async def test_for_the_depth_of_a_subscription(self, node: bus.Node) -> None:
        """The publisher's own depth is for late joiners; matched subscriptions have their own depth."""
        subscription = await node.create_subscription(Numbered, "t", 5000)
        publisher = await node.create_publisher(Numbered, "t", 1)
        for number in range(5000):
            publisher.publish(numbered(number, 400))
        for number in range(5000):
            assert (await subscription.receive())[0] == numbered(number, 400)
        assert subscription.statistics().dropped == {}

    @by_shared_memory
    async def test_for_depth_it_grows_once(self, node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> None:
        """From its usual size to the size that the depth will need, because growing delays messages."""
        made: list[int] = []
        make_ring = segments.make_ring

        def note(capacity: int, index_length: int, first_seq: int) -> Any:
            made.append(capacity)
            return make_ring(capacity, index_length, first_seq)

        monkeypatch.setattr(segments, "make_ring", note)
        publisher = await node.create_publisher(Numbered, "t", 1000)
        for number in range(3000):
            publisher.publish(numbered(number, 1000))
        first, usual, last = made
        assert first < usual == 64 << 10
        assert 1000 * 1000 < last <= 4000 * 1000

    async def test_for_the_size_of_messages(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Numbered, "t", 10)
        publisher = await node.create_publisher(Numbered, "t", 10)
        for number, size in enumerate([4, 100_000, 4, 5 << 20, 40, 20 << 20, 0]):
            publisher.publish(numbered(number, size))
            assert (await subscription.receive())[0] == numbered(number, size)
        assert subscription.statistics().dropped == {}

    @pytest.mark.parametrize("qos", [bus.QoSProfile(100), KEEP_ALL], ids=["keep last", "keep all"])
    async def test_many_times_before_anybody_reads(self, node: bus.Node, qos: bus.QoSProfile) -> None:
        """The reader follows from ring to ring; no message is lost, repeated or out of order."""
        subscription = await node.create_subscription(Numbered, "t", qos)
        publisher = await node.create_publisher(Numbered, "t", qos)
        sizes = [4 << step for step in range(17)] * 2 + [40] * 60
        for number, size in enumerate(sizes):
            assert publisher.publish(numbered(number, size))
        for number, size in enumerate(sizes):
            assert (await subscription.receive())[0] == numbered(number, size)
        assert subscription.statistics().dropped == {}

    async def test_with_several_that_read_at_their_own_pace(self, node: bus.Node) -> None:
        chance = random.Random(7)
        subscriptions = [await node.create_subscription(Numbered, "t", KEEP_ALL) for _ in range(3)]
        publisher = await node.create_publisher(Numbered, "t", KEEP_ALL)
        sizes = [chance.choice([0, 40, 4000, 100_000, 1_000_000]) for _ in range(150)]

        async def hear(subscription: bus.Subscription[Numbered], pauses: int) -> None:
            for number, size in enumerate(sizes):
                assert (await subscription.receive())[0] == numbered(number, size)
                for _ in range(pauses):
                    await asyncio.sleep(0)

        hearing = [
            asyncio.create_task(hear(one, pace)) for one, pace in zip(subscriptions, (0, 3, 9), strict=True)
        ]
        for number, size in enumerate(sizes):
            await publisher.send(numbered(number, size))
        await asyncio.gather(*hearing)

    async def test_history_is_taken_along(self, node: bus.Node) -> None:
        qos = bus.QoSProfile(5, durability="transient_local")
        publisher = await node.create_publisher(Numbered, "t", qos)
        sizes = [40, 40, 40, 40, 200_000, 40, 2_000_000]
        for number, size in enumerate(sizes):
            publisher.publish(numbered(number, size))
        late = await node.create_subscription(Numbered, "t", qos)
        publisher.publish(numbered(7, 40))
        heard = [(await late.receive())[0] for _ in range(6)]
        assert heard == [numbered(number, size) for number, size in [*enumerate(sizes)][2:]] + [
            numbered(7, 40)
        ]

    @by_shared_memory
    async def test_the_old_rings_are_let_go(self, node: bus.Node) -> None:
        """This process is publisher and subscription, and only keeps descriptors of the last ring."""
        subscription = await node.create_subscription(Numbered, "t", 10)
        publisher = await node.create_publisher(Numbered, "t", 10)
        publisher.publish(numbered(0, 4))
        await subscription.receive()
        before = rings()
        for number in range(1, 12):
            publisher.publish(numbered(number, 4 << number))
            publisher.publish(numbered(number, (4 << number) * 1000))
            for _ in range(2):
                assert (await subscription.receive())[0].number == number
        await until(lambda: rings() == before)

    @by_shared_memory
    async def test_where_there_is_no_memory_for_it(
        self, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """First old messages are dropped, then `publish` raises; earlier messages are still read."""
        subscription = await node.create_subscription(Numbered, "t", 1000)
        publisher = await node.create_publisher(Numbered, "t", 1000)

        def refuse(*_: object) -> Any:
            raise OSError(12, "Cannot allocate memory")

        monkeypatch.setattr(segments, "make_ring", refuse)
        for number in range(1000):
            publisher.publish(numbered(number, 400))
        with pytest.raises(bus.SharedMemoryError, match="no shared memory for a message of 1000"):
            publisher.publish(numbered(1000, 1_000_000))
        await until(lambda: accounted(subscription) == 1000)
        kept = []
        while taken := subscription.take():
            kept.append(taken[0].number)
        assert 0 < len(kept) < 1000
        assert kept == list(range(1000 - len(kept), 1000))
        assert subscription.statistics().dropped == {"replaced": 1000 - len(kept)}
        monkeypatch.undo()
        publisher.publish(numbered(1000, 1_000_000))
        assert (await subscription.receive())[0] == numbered(1000, 1_000_000)


class TestReading:
    async def test_what_is_lapped_before_anybody_looks_is_counted(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", 5)
        publisher = await node.create_publisher(Int32, "t", 5)
        for number in range(20_000):
            publisher.publish(Int32(data=number))
        await until(lambda: accounted(subscription) == 20_000)
        assert [(await subscription.receive())[0].data for _ in range(5)] == list(range(19_995, 20_000))

    @by_shared_memory
    @pytest.mark.parametrize("turns", [0, 1, 20])
    async def test_the_last_word_of_one_that_rings_nobody(
        self, node: bus.Node, monkeypatch: pytest.MonkeyPatch, turns: int
    ) -> None:
        """It left before it knew how to wake its reader, so the broker's message wakes the reader."""
        monkeypatch.setattr(ShmSender, "attach", lambda *_: None)
        subscription = await node.create_subscription(Int32, "t", 5)
        publisher = await node.create_publisher(Int32, "t", 5)
        await subscription.wait_for_publishers()
        receiving = asyncio.create_task(subscription.receive())
        for _ in range(turns):
            await asyncio.sleep(0)
        publisher.publish(Int32(data=7))
        await publisher.close()
        assert (await receiving)[0].data == 7


def rings() -> int:
    """The number of open descriptors of rings in this process."""
    found = 0
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found += "busd-ring" in str(entry.readlink())
        except OSError:
            continue
    return found


class TestBusyPolling:
    async def test_messages_come_and_others_have_their_turns(self, node: bus.Node) -> None:
        heard: list[int] = []
        publisher = await node.create_publisher(Int32, "t", 10)
        subscription = await node.create_subscription(
            Int32, "t", 10, lambda message: heard.append(message.data), busy_poll=0.05
        )
        turns = 0
        for number in range(200):
            publisher.publish(Int32(data=number))
            while len(heard) <= number:
                await asyncio.sleep(0)
                turns += 1
        assert heard == list(range(200))
        assert turns >= 200
        assert subscription.statistics().dropped == {}

    @by_shared_memory
    async def test_what_comes_after_the_polling_has_ended_wakes(self, node: bus.Node) -> None:
        """Polling ends by itself; after that the doorbell wakes the subscription again."""
        publisher = await node.create_publisher(Int32, "t", 10)
        subscription = await node.create_subscription(Int32, "t", 10, busy_poll=0.002)
        shm_context = node._opened().link.shm_context
        assert shm_context is not None
        for number in range(3):
            publisher.publish(Int32(data=number))
            assert (await subscription.receive())[0].data == number
            await until(lambda: not shm_context._is_polling)
