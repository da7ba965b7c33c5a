"""After busd was away: the subscriptions that a publisher waits for, how long, and what happens next.

The loop's time jumps (`tests/jumping_loop.py`), so the test can tell ten seconds from one on any machine.
"""

import asyncio

import pytest

import bus
from accounts_world import TOPIC, Numbered, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.effects import Send
from semantics import KEEP_ALL
from two_processes import LISTENER, TALKER, Play, nodes, restart_busd, two

__all__ = ["two"]

by_socket = pytest.mark.parametrize("route", ["socket"], indirect=True)
by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)
LONG = "x" * 100_000


def queued(publisher: bus.Publisher[Numbered]) -> int:
    return publisher.statistics().queued


async def came_by_socket(world: World) -> int:
    """Number of samples that this busd has routed."""
    await world.settle()
    now_ns, asker = int(asyncio.get_running_loop().time() * 1e9), world.peer(TALKER).id
    effects = world.broker.handle(now_ns, asker, m.GetPeers(request=1))
    (answer,) = (one.message for one in effects if isinstance(one, Send))
    return answer.routing.samples  # type: ignore[attr-defined, no-any-return]


class TestBySocket:
    """A publisher waits for a subscription that was matched before. It misses nothing if it returns soon."""

    @by_socket
    @pytest.mark.parametrize(
        ("qos", "before_s", "after_s"), [(QoSProfile(10), 0.8, 1.2), (KEEP_ALL, 8, 12)], ids=["depth", "all"]
    )
    def test_so_long_and_no_longer(self, two: Play, qos: QoSProfile, before_s: float, after_s: float) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            await listener.create_subscription(Numbered, TOPIC, qos)
            publisher = await talker.create_publisher(Numbered, TOPIC, qos)
            await restart_busd(world, TALKER)
            publisher.publish(Numbered())
            await asyncio.sleep(before_s)
            assert (queued(publisher), await came_by_socket(world)) == (1, 0)
            await asyncio.sleep(after_s - before_s)
            assert (queued(publisher), await came_by_socket(world)) == (0, 1)
            world.processes[LISTENER].gate.set()

        two(story)

    @by_socket
    @pytest.mark.parametrize("qos", [QoSProfile(10), KEEP_ALL], ids=["depth", "all"])
    def test_until_it_is_back(self, two: Play, qos: QoSProfile) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            subscription = await listener.create_subscription(Numbered, TOPIC, qos)
            publisher = await talker.create_publisher(Numbered, TOPIC, qos)
            await restart_busd(world, TALKER)
            for number in range(5):
                publisher.publish(Numbered(1, number))
            world.processes[LISTENER].gate.set()
            await world.processes[LISTENER].ask()
            await world.settle()
            assert queued(publisher) == 0
            assert [(await subscription.receive())[0].number for _ in range(5)] == [*range(5)]
            assert subscription.statistics().dropped == {}

        two(story)

    @by_socket
    def test_while_the_depth_has_room_for_it(self, two: Play) -> None:
        """A longer wait would drop the messages that it is meant to save."""

        async def story(world: World) -> None:
            talker, listener = nodes(world)
            await listener.create_subscription(Numbered, TOPIC, 10)
            publisher = await talker.create_publisher(Numbered, TOPIC, 10)
            await restart_busd(world, TALKER)
            for _ in range(10):
                publisher.publish(Numbered())
                await asyncio.sleep(0)
            assert queued(publisher) == 10
            publisher.publish(Numbered())
            await asyncio.sleep(0)
            found = publisher.statistics()
            assert (found.queued, found.replaced) == (0, 0)
            assert await came_by_socket(world) == 11
            world.processes[LISTENER].gate.set()

        two(story)

    @by_socket
    @pytest.mark.parametrize("why", ["it has left", "it is best effort"])
    def test_others_are_not(self, two: Play, why: str) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            reliability = "best_effort" if why == "it is best effort" else "reliable"
            requested = QoSProfile(10, reliability=reliability)
            subscription = await listener.create_subscription(Numbered, TOPIC, requested)
            publisher = await talker.create_publisher(Numbered, TOPIC, 10)
            if why == "it has left":
                await subscription.close()
                await world.settle()
            await restart_busd(world, TALKER)
            publisher.publish(Numbered())
            assert await came_by_socket(world) == 1
            world.processes[LISTENER].gate.set()

        two(story)

    @by_socket
    def test_what_was_not_acknowledged_comes_once_more(self, two: Play) -> None:
        """The message was in the busd that died. The subscription recognizes messages that it has taken by
        their numbers.
        """

        async def story(world: World) -> None:
            talker, listener = nodes(world)
            subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
            publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
            for number in range(8):
                publisher.publish(Numbered(1, number))
                await world.settle()
                if number == 4:
                    world.block(LISTENER)
            world.model.blocked.clear()
            await restart_busd(world, LISTENER, TALKER)
            publisher.publish(Numbered(1, 8))
            await world.settle()
            assert [(await subscription.receive())[0].number for _ in range(9)] == [*range(9)]
            assert subscription.statistics().dropped == {}

        two(story)


class TestBySharedMemory:
    @by_shared_memory
    def test_a_reader_that_does_not_come_back_is_waited_for_ten_seconds(self, two: Play) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
            publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
            await publisher.wait_for_subscriptions()
            while publisher.publish(Numbered(padding=LONG)):
                pass
            sending = asyncio.create_task(publisher.send(Numbered(padding=LONG)))
            await restart_busd(world, TALKER)
            await asyncio.sleep(8)
            assert not sending.done()
            await asyncio.sleep(4)
            assert sending.done()
            world.processes[LISTENER].gate.set()

        two(story)

    @by_shared_memory
    def test_one_that_comes_back_goes_on_and_is_waited_for(self, two: Play) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            subscription = await listener.create_subscription(Numbered, TOPIC, KEEP_ALL)
            publisher = await talker.create_publisher(Numbered, TOPIC, KEEP_ALL)
            await publisher.wait_for_subscriptions()
            number = 0
            while publisher.publish(Numbered(1, number, LONG)):
                number += 1
            await restart_busd(world, TALKER, LISTENER)
            sending = asyncio.create_task(publisher.send(Numbered(1, number, LONG)))
            await asyncio.sleep(100)
            assert not sending.done()
            heard = [(await subscription.receive())[0].number for _ in range(number + 1)]
            assert heard == [*range(number + 1)]
            assert subscription.statistics().dropped == {}

        two(story)

    @by_shared_memory
    def test_what_nobody_reads_by_socket_goes_there_no_longer_than_somebody_may_come_back(
        self, two: Play, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        async def story(world: World) -> None:
            talker, _ = nodes(world)
            monkeypatch.setenv("BUS_ROUTE", "socket")
            far = world.processes[await world.open_process(shares=False)]
            publisher = await talker.create_publisher(Numbered, TOPIC, 10)
            await far.node.create_subscription(Numbered, TOPIC, 10)
            await world.settle()
            publisher.publish(Numbered())
            assert await came_by_socket(world) == 1
            await restart_busd(world, TALKER, LISTENER)
            await asyncio.sleep(8)
            publisher.publish(Numbered())
            assert await came_by_socket(world) == 1
            await asyncio.sleep(4)
            publisher.publish(Numbered())
            assert await came_by_socket(world) == 1
            far.gate.set()

        two(story)


class TestTheGraph:
    def test_one_that_waits_for_a_change_does_not_end_the_waiting_of_another(self, two: Play) -> None:
        async def story(world: World) -> None:
            talker, listener = nodes(world)
            waiting = {
                topic: asyncio.create_task(
                    listener.wait_for_graph(lambda graph, topic=topic: topic in graph.topics())
                )
                for topic in ("/first", "/second")
            }
            for topic, task in waiting.items():
                await asyncio.sleep(1)
                assert not task.done()
                await talker.create_publisher(Numbered, topic, 10)
                await asyncio.sleep(1)
                assert task.done()

        two(story)

    def test_the_wall_clock_may_be_set(self, two: Play, monkeypatch: pytest.MonkeyPatch) -> None:
        """Stamps use the monotonic clock. The times that a program sees follow the wall clock within a
        second.
        """
        hour_ns = 3_600_000_000_000

        async def story(world: World) -> None:
            talker, listener = nodes(world)
            subscription = await listener.create_subscription(Numbered, TOPIC, 10)
            publisher = await talker.create_publisher(Numbered, TOPIC, 10)
            publisher.publish(Numbered())
            before = (await subscription.receive())[1].source_timestamp
            clock = bus.link.link.time_ns
            monkeypatch.setattr(bus.link.link, "time_ns", lambda: clock() + hour_ns)
            for _ in range(2):
                publisher.publish(Numbered())
                after = (await subscription.receive())[1].source_timestamp
                await asyncio.sleep(1)
            assert abs(after - before - hour_ns) < hour_ns / 2

        two(story)
