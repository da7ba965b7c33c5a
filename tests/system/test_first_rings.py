"""A publisher's first ring: it is small, and grows as soon as the publisher needs more."""

import asyncio
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.delivery import ring_size, shm_sender
from bus.msg.rcl_interfaces import Log
from bus.msg.std_msgs import Int32, String
from bus.shm import segments
from conftest import Daemon
from programs import LIMIT_S
from semantics import KEEP_ALL, LATCHED, accounted, node, send_all, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)

FIRST, USUAL, USUAL_KEEP_ALL = 4 << 10, 64 << 10, 1 << 20
LAP = FIRST // 64
"""So many short messages fill the first ring."""

MANY_NODES = """
import asyncio, gc, os, sys
import bus
from benchmarks.adapters.holding import usage_of
from bus.msg.std_msgs import String

def now():
    gc.collect()
    usage = usage_of("self")
    return usage.private + usage.shared, len(os.listdir("/proc/self/fd"))

async def make(name):
    one = bus.Node(name, arguments=[])
    await one.open()
    await one.create_publisher(String, name)
    await one.create_subscription(String, name)
    return one

async def main():
    nodes = [await make("first")]
    kib, descriptors = now()
    nodes += [await make(f"node{index}") for index in range(int(sys.argv[1]))]
    kib_now, descriptors_now = now()
    print(kib_now - kib, descriptors_now - descriptors)
    await asyncio.gather(*(one.close() for one in nodes))

bus.run(main())
"""
"""Prints the KiB and the descriptors that so many nodes need."""


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The capacity of each ring made during the test."""
    made: list[int] = []
    make_ring = segments.make_ring

    def note(capacity: int, index_length: int, first_seq: int) -> Any:
        made.append(capacity)
        return make_ring(capacity, index_length, first_seq)

    monkeypatch.setattr(segments, "make_ring", note)
    return made


@pytest.fixture
def none_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if this process had many publishers already."""
    monkeypatch.setattr(shm_sender, "EARLY", 0)


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Makes all earlier messages seem old."""
    laps_slowly = ring_size.laps_slowly

    def pass_by() -> None:
        monkeypatch.setattr(
            shm_sender, "laps_slowly", lambda writer, now_ns: laps_slowly(writer, now_ns + 10**12)
        )

    return pass_by


def numbers(first: int, end: int) -> list[Int32]:
    return [Int32(data=number) for number in range(first, end)]


async def take(subscription: bus.Subscription[Int32], count: int) -> list[int]:
    return [(await subscription.receive())[0].data for _ in range(count)]


def rings() -> Counter[str]:
    """The number of rings that this process has mapped, and that it has open."""
    found: Counter[str] = Counter()
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found["open"] += "busd-ring" in str(entry.readlink())
        except OSError:
            continue
    found["mapped"] = Path("/proc/self/maps").read_text().count("busd-ring")
    return found


@by_shared_memory
class TestMatch:
    @pytest.mark.parametrize(
        ("qos", "grown"), [(1000, USUAL), (KEEP_ALL, USUAL_KEEP_ALL)], ids=["1000", "all"]
    )
    async def test_it_grows_with_the_first_one(
        self, node: bus.Node, made: list[int], qos: bus.QoS, grown: int
    ) -> None:
        """So it needs no busd later, while messages flow. Messages before the match don't count."""
        publisher = await node.create_publisher(Int32, "t", qos)
        for message in numbers(0, 3):
            publisher.publish(message)
        assert made == [FIRST]
        subscription = await node.create_subscription(Int32, "t", qos)
        await publisher.wait_for_subscriptions()
        assert made == [FIRST, grown]
        await send_all(publisher, numbers(3, 500))
        assert await take(subscription, 497) == list(range(3, 500))
        async with asyncio.TaskGroup() as group:
            for _ in range(3):
                group.create_task(node.create_subscription(Int32, "t", qos))
        assert len(made) == 2

    async def test_of_many_only_some(
        self, node: bus.Node, made: list[int], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(shm_sender, "EARLY", shm_sender.ShmSender._early + 2)
        publishers = [await node.create_publisher(Int32, f"t{index}") for index in range(5)]
        for index in range(5):
            await node.create_subscription(Int32, f"t{index}")
            await publishers[index].wait_for_subscriptions()
        assert made == [FIRST] * 5 + [USUAL] * 2
        await publishers[0].close()  # another publisher may take its place
        await publishers.pop().close()
        publishers.append(await node.create_publisher(Int32, "t4"))
        await publishers[-1].wait_for_subscriptions()
        assert made[7:] == [FIRST, USUAL]


@by_shared_memory
@pytest.mark.usefixtures("none_early")
class TestSize:
    @pytest.mark.parametrize(
        ("qos", "grown"),
        [(10, USUAL), (1100, 2 * USUAL), (KEEP_ALL, USUAL_KEEP_ALL)],
        ids=["10", "1100", "all"],
    )
    async def test_it_grows_once_its_records_go_round(
        self, node: bus.Node, made: list[int], qos: bus.QoS, grown: int
    ) -> None:
        subscription = await node.create_subscription(Int32, "t", qos)
        publisher = await node.create_publisher(Int32, "t", qos)
        while made == [FIRST]:
            publisher.publish(Int32(data=publisher.statistics().published))
            await asyncio.sleep(0)
        assert made == [FIRST, grown]
        assert LAP // 2 < publisher.statistics().published <= LAP + 1
        await send_all(publisher, numbers(publisher.statistics().published, 20 * LAP))
        assert len(made) == 2
        await until(lambda: accounted(subscription) == 20 * LAP)  # the reader has moved to the larger ring
        depth = qos if isinstance(qos, int) else 20 * LAP
        assert await take(subscription, depth) == list(range(20 * LAP - depth, 20 * LAP))

    async def test_nothing_is_lost_on_the_way(self, node: bus.Node, made: list[int]) -> None:
        """Even if the reader does not know the larger ring yet."""
        subscription = await node.create_subscription(Int32, "t", 10_000)
        publisher = await node.create_publisher(Int32, "t", 10_000)
        for message in numbers(0, 10_000):
            publisher.publish(message)
        assert await take(subscription, 10_000) == list(range(10_000))
        assert subscription.statistics().dropped == {}
        assert len(made) <= 4  # not at each doubling

    async def test_one_that_says_little_stays_small(
        self, node: bus.Node, made: list[int], later: Callable[[], None]
    ) -> None:
        """Its messages wrap around, and it still keeps its depth."""
        publisher = await node.create_publisher(Int32, "t", bus.QoSProfile(10, durability="transient_local"))
        later()
        for message in numbers(0, 3 * LAP):
            publisher.publish(message)
        assert made == [FIRST]
        late = await node.create_subscription(Int32, "t", bus.QoSProfile(10, durability="transient_local"))
        assert await take(late, 10) == list(range(3 * LAP - 10, 3 * LAP))

    async def test_it_grows_when_that_one_says_more(
        self, node: bus.Node, made: list[int], monkeypatch: pytest.MonkeyPatch, later: Callable[[], None]
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", 10)
        with monkeypatch.context() as context:
            context.setattr(shm_sender, "LAP_S", 0.001)
            later()
            for message in numbers(0, 2 * LAP):
                publisher.publish(message)
        monkeypatch.undo()
        assert made == [FIRST]
        made_later: list[int] = []
        make_ring = segments.make_ring
        monkeypatch.setattr(
            segments, "make_ring", lambda *sizes: (made_later.append(sizes[0]), make_ring(*sizes))[1]
        )

        def talk() -> bool:
            for message in numbers(0, 2 * LAP):
                publisher.publish(message)
            return bool(made_later)

        await until(talk)
        assert made_later == [USUAL]

    async def test_depth_is_no_matter_of_pace(
        self, node: bus.Node, made: list[int], later: Callable[[], None]
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", bus.QoSProfile(500, durability="transient_local"))
        later()
        for message in numbers(0, 1000):
            publisher.publish(message)
        assert made == [FIRST, USUAL]
        late = await node.create_subscription(Int32, "t", bus.QoSProfile(500, durability="transient_local"))
        assert await take(late, 500) == list(range(500, 1000))

    async def test_where_there_is_no_memory_for_the_usual_one(
        self, node: bus.Node, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The first ring can hold its depth: it loses nothing, and does not ask for memory each time."""
        subscription = await node.create_subscription(Int32, "t", 10)
        publisher = await node.create_publisher(Int32, "t", 10)
        asked = 0

        def refuse(*_: object) -> Any:
            nonlocal asked
            asked += 1
            raise OSError(12, "Cannot allocate memory")

        monkeypatch.setattr(segments, "make_ring", refuse)
        for first in range(0, 20 * LAP, 10):
            for message in numbers(first, first + 10):
                publisher.publish(message)
            assert await take(subscription, 10) == list(range(first, first + 10))
        assert asked == 1
        assert subscription.statistics().dropped == {}


@by_shared_memory
@pytest.mark.usefixtures("none_early")
class TestWithoutBroker:
    """busd tells readers of a larger ring. Without busd, the publisher keeps its ring until busd is back."""

    @pytest.mark.parametrize("qos", [10, KEEP_ALL], ids=["keep last", "keep all"])
    async def test_messages_flow(self, node: bus.Node, daemon: Daemon, made: list[int], qos: bus.QoS) -> None:
        subscription = await node.create_subscription(Int32, "t", qos)
        publisher = await node.create_publisher(Int32, "t", qos)
        await publisher.wait_for_subscriptions()
        daemon.kill()
        await until(lambda: not publisher._core.id)
        for first in range(0, 10 * LAP, 10):
            await send_all(publisher, numbers(first, first + 10))
            assert await take(subscription, 10) == list(range(first, first + 10))
        assert made == [FIRST]
        daemon.restart()
        await until(lambda: publisher._core.id and subscription._core.id)
        while made == [FIRST]:  # messages before the reconnection may count as slow
            await send_all(publisher, numbers(0, 10))
            assert await take(subscription, 10) == list(range(10))
            await asyncio.sleep(0.001)


class TestCost:
    @by_shared_memory
    async def test_who_reads_keeps_no_descriptor_of_a_ring(self, node: bus.Node) -> None:
        publishers = [await node.create_publisher(String, f"t{index}") for index in range(5)]
        subscriptions = [await node.create_subscription(String, f"t{index}") for index in range(5)]
        for publisher, subscription in zip(publishers, subscriptions, strict=True):
            await publisher.wait_for_subscriptions()
            publisher.publish(String(data="here"))
            assert (await subscription.receive())[0].data == "here"
        assert rings() == {"open": 5, "mapped": 10}

    @by_shared_memory
    async def test_what_a_node_logs_needs_no_ring(self, node: bus.Node) -> None:
        before = rings()
        node.get_logger().info("one")
        late = await node.create_subscription(Log, "/rosout", LATCHED)
        node.get_logger().info("two")
        assert [(await late.receive())[0].msg for _ in range(2)] == ["one", "two"]
        assert rings() == before
        (match,) = (await node.graph()).matches
        assert match.route == "socket"

    @by_shared_memory
    @pytest.mark.usefixtures("daemon")
    def test_many_nodes(self) -> None:
        """A node with a publisher, a subscription and its log: 51 KiB and 1.2 descriptors. 500: 25 MiB.

        In a process of its own, because earlier tests change the memory of this one.
        """
        number = 800  # Python takes memory by the MiB
        command = [sys.executable, "-c", MANY_NODES, str(number)]
        environ = {**os.environ, "PYTHONASYNCIODEBUG": ""}  # it notes the origin of each task
        said = subprocess.run(command, capture_output=True, check=True, timeout=LIMIT_S, env=environ).stdout
        kib, descriptors = map(int, said.split())
        assert kib < 51 * number
        assert descriptors < 1.2 * number
