"""Delivery, depth, late joiners and threads, end to end through a real daemon, on both event loops."""

import asyncio
import sys
import threading
import time
from typing import Any

import pytest

import bus
from bus.events import MessageLost
from bus.msg.std_msgs import Int32, String
from semantics import KEEP_ALL, LATCHED, Wheel, accounted, node, send_all, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

_LEAVING = """
import bus
from bus.msg.std_msgs import String

async def main():
    async with bus.Node("leaving", arguments=()) as node:
        publisher = await node.create_publisher(String, "topic", 1000)
        for number in range(500):
            publisher.publish(String(data=str(number) * 2000))

bus.run(main())
"""


class TestDelivery:
    async def test_iteration_gives_messages_in_order(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "topic", 10)
        publisher = await node.create_publisher(String, "topic", 10)
        for number in range(5):
            publisher.publish(String(data=f"Hello World: {number}"))
        heard = []
        async for message in subscription:
            heard.append(message.data)
            if len(heard) == 5:
                break
        assert heard == [f"Hello World: {number}" for number in range(5)]

    async def test_callbacks_of_every_kind(self, node: bus.Node) -> None:
        heard: dict[str, list[Any]] = {"plain": [], "info": [], "async": [], "async info": []}

        async def hear(message: String) -> None:
            await asyncio.sleep(0)
            heard["async"].append(message.data)

        async def hear_info(message: String, info: bus.MessageInfo) -> None:
            heard["async info"].append((message.data, info.publication_sequence_number))

        await node.create_subscription(String, "t", 10, lambda message: heard["plain"].append(message.data))
        await node.create_subscription(
            String, "t", 10, lambda message, info: heard["info"].append((message.data, info))
        )
        await node.create_subscription(String, "t", 10, hear)
        await node.create_subscription(String, "t", 10, hear_info)
        publisher = await node.create_publisher(String, "t", 10)
        before = time.time_ns()
        publisher.publish(String(data="a"))
        publisher.publish(String(data="b"))
        await until(lambda: all(len(one) == 2 for one in heard.values()))
        assert heard["plain"] == heard["async"] == ["a", "b"]
        assert heard["async info"] == [("a", 1), ("b", 2)]
        (_, first), (_, second) = heard["info"]
        assert (first.publication_sequence_number, second.publication_sequence_number) == (1, 2)
        assert (first.reception_sequence_number, second.reception_sequence_number) == (1, 2)
        assert first.publisher_gid == publisher.gid
        margin = 1_000_000  # the wall clock may be slewed
        assert before - margin <= first.source_timestamp <= first.received_timestamp + margin

    async def test_an_empty_string_is_a_message(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "topic", 10)
        (await node.create_publisher(String, "topic", 10)).publish(String())
        assert (await subscription.receive())[0] == String(data="")

    async def test_large_messages_arrive_whole(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "topic", KEEP_ALL)
        publisher = await node.create_publisher(String, "topic", KEEP_ALL)
        texts = [chr(ord("a") + number) * (300_000 * (number + 1)) for number in range(6)]
        sending = asyncio.create_task(send_all(publisher, [String(data=text) for text in texts]))
        for text in texts:
            assert (await subscription.receive())[0].data == text
        await sending

    async def test_nothing_is_lost_where_the_publisher_leaves(self, node: bus.Node) -> None:
        """When it exits, more messages are in transit than fit into a socket."""
        subscription = await node.create_subscription(String, "topic", 1000)
        program = await asyncio.create_subprocess_exec(sys.executable, "-c", _LEAVING)
        heard = [(await subscription.receive())[0].data for _ in range(500)]
        assert heard == [str(number) * 2000 for number in range(500)]
        assert await program.wait() == 0

    async def test_a_users_own_struct(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Wheel, "wheel", 10)
        publisher = await node.create_publisher(Wheel, "wheel", 10)
        publisher.publish(Wheel("left", [1.0, 2.5]))
        assert (await subscription.receive())[0] == Wheel("left", [1.0, 2.5])

    async def test_a_callback_that_keeps_up_loses_nothing_of_a_burst(self, node: bus.Node) -> None:
        heard: list[int] = []
        subscription = await node.create_subscription(
            Int32, "t", 10, lambda message: heard.append(message.data)
        )
        publisher = await node.create_publisher(Int32, "t", 1000)
        for number in range(1000):
            publisher.publish(Int32(data=number))
        await until(lambda: heard[-1:] == [999])
        assert heard == sorted(heard)
        assert accounted(subscription) == 1000


class TestDepth:
    async def test_a_slow_subscription_keeps_the_newest_and_counts_the_rest(self, node: bus.Node) -> None:
        lost: list[MessageLost] = []
        subscription = await node.create_subscription(
            Int32, "t", 10, events=bus.SubscriptionEvents(message_lost=lost.append)
        )
        publisher = await node.create_publisher(Int32, "t", 100)
        for number in range(100):
            publisher.publish(Int32(data=number))
        await until(lambda: accounted(subscription) == 100 and lost and lost[-1].total_count == 90)
        kept = []
        while taken := subscription.take():
            kept.append(taken[0].data)
        assert kept == list(range(90, 100))
        assert subscription.statistics().dropped == {"replaced": 90}

    async def test_order_is_kept_under_flood(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", 5)
        publisher = await node.create_publisher(Int32, "t", 5)
        heard = []
        for number in range(5000):
            publisher.publish(Int32(data=number))
            if number % 100 == 0:
                await asyncio.sleep(0)
            while taken := subscription.take():
                heard.append(taken[0].data)
        await until(lambda: accounted(subscription) + publisher.statistics().queued == 5000)
        while taken := subscription.take():
            heard.append(taken[0].data)
        assert heard == sorted(set(heard))
        assert heard[-1] == 4999

    async def test_keep_all_loses_nothing_and_holds_the_publisher_back(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        sent = 0
        while publisher.publish(Int32(data=sent)):
            sent += 1
            if sent % 1000 == 0:
                await asyncio.sleep(0)
        assert publisher.statistics().refused == 1
        sending = asyncio.create_task(publisher.send(Int32(data=sent)))
        await asyncio.sleep(0)
        assert not sending.done()
        for number in range(sent + 1):
            assert (await subscription.receive())[0].data == number
        await sending
        assert subscription.statistics().dropped == {}

    async def test_a_cancelled_send_was_not_published(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        sent = 0
        while publisher.publish(Int32(data=sent)):
            sent += 1
        sending = asyncio.create_task(publisher.send(Int32(data=-1)))
        await asyncio.sleep(0)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
        heard = [(await subscription.receive())[0].data for _ in range(sent)]
        assert heard == list(range(sent))
        await publisher.send(Int32(data=-2))
        assert (await subscription.receive())[0].data == -2

    async def test_one_that_was_cancelled_before_it_began_was_not_published(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", 10)
        publisher = await node.create_publisher(Int32, "t", 10)
        sending = asyncio.create_task(publisher.send(Int32(data=1)))
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
        await asyncio.gather(*(publisher.send(Int32(data=number)) for number in range(2, 5)))
        assert [(await subscription.receive())[0].data for _ in range(3)] == [2, 3, 4]
        assert publisher.statistics().published == 3

    async def test_send_raises_when_it_is_awaited(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Int32, "t", 10)
        wrong: Any = Int32(data="x")  # type: ignore[arg-type]
        sending = publisher.send(wrong)
        with pytest.raises(bus.MessageTypeError, match="data"):
            await sending
        (error,) = await asyncio.gather(publisher.send(wrong), return_exceptions=True)
        assert isinstance(error, bus.MessageTypeError)  # type: ignore[has-type]
        await publisher.close()
        with pytest.raises(bus.ConnectionClosed):
            await publisher.send(Int32())

    async def test_a_callback_may_send_on(self, node: bus.Node) -> None:
        relay = await node.create_publisher(Int32, "there", 10)
        await node.create_subscription(Int32, "here", 10, relay.send)
        subscription = await node.create_subscription(Int32, "there", 10)
        publisher = await node.create_publisher(Int32, "here", 10)
        for number in range(5):
            await publisher.send(Int32(data=number))
        assert [(await subscription.receive())[0].data for _ in range(5)] == list(range(5))

    async def test_sends_that_never_wait_let_the_loop_turn(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)

        async def flood() -> None:
            for number in range(100_000):  # without a subscription there is always room
                await publisher.send(Int32(data=number))

        flooding = asyncio.create_task(flood())
        await asyncio.sleep(0)
        assert not flooding.done()
        flooding.cancel()
        await asyncio.gather(flooding, return_exceptions=True)
        assert publisher.statistics().published % 100 == 0  # cancelled between two messages

    async def test_a_slow_keep_all_subscription_that_leaves_releases_the_publisher(
        self, node: bus.Node
    ) -> None:
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        while publisher.publish(Int32()):
            pass
        sending = asyncio.create_task(publisher.send(Int32(data=7)))
        await subscription.close()
        await sending


class TestLateJoiners:
    async def test_transient_local_gives_the_last_ones_in_order_before_new_ones(self, node: bus.Node) -> None:
        publishers = [await node.create_publisher(Int32, "t", LATCHED) for _ in range(2)]
        for number in range(8):
            for index, publisher in enumerate(publishers):
                publisher.publish(Int32(data=100 * index + number))
        late = await node.create_subscription(Int32, "t", bus.QoSProfile(3, durability="transient_local"))
        publishers[0].publish(Int32(data=50))
        heard: list[int] = []
        async for message in late:
            heard.append(message.data)
            if len(heard) == 7:
                break
        assert [one for one in heard if one < 100] == [5, 6, 7, 50]
        assert [one for one in heard if one >= 100] == [105, 106, 107]

    async def test_best_available_gives_what_each_publisher_keeps(self, node: bus.Node) -> None:
        offers = LATCHED, bus.QoSProfile(10, reliability="best_effort")
        publishers = [await node.create_publisher(Int32, "t", offer) for offer in offers]
        for index, publisher in enumerate(publishers):
            publisher.publish(Int32(data=index))
        qos = bus.QoSProfile(10, reliability="best_effort", durability="best_available")
        late = await node.create_subscription(Int32, "t", qos)
        await publishers[1].wait_for_subscriptions()
        publishers[1].publish(Int32(data=2))
        assert {(await late.receive())[0].data for _ in range(2)} == {0, 2}
        assert late.statistics().expected == 2
        with pytest.raises(bus.ConfigurationError, match="best_available is for subscriptions"):
            await node.create_publisher(Int32, "t", bus.QoSProfile(durability="best_available"))

    async def test_volatile_late_joiners_get_only_what_is_new(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Int32, "t", LATCHED)
        publisher.publish(Int32(data=1))
        late = await node.create_subscription(Int32, "t", 10)
        publisher.publish(Int32(data=2))
        assert (await late.receive())[0].data == 2


class TestThreads:
    async def test_publish_from_other_threads(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)

        def work(first: int) -> None:
            for number in range(first, first + 500):
                assert publisher.publish(Int32(data=number))

        threads = [threading.Thread(target=work, args=(1000 * index,)) for index in range(4)]
        for thread in threads:
            thread.start()
        heard = [(await subscription.receive())[0].data for _ in range(2000)]
        for thread in threads:
            thread.join()
        for index in range(4):
            mine = [number for number in heard if number // 1000 == index]
            assert mine == list(range(1000 * index, 1000 * index + 500))


class TestRaw:
    async def test_a_raw_subscription_gets_the_bytes(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "t", 10, raw=True)
        publisher = await node.create_publisher(String, "t", 10)
        publisher.publish_encoded(b"\xc1 no message")
        publisher.publish(String(data="x"))
        first, second = [(await subscription.receive())[0] for _ in range(2)]
        assert [first, second] == [b"\xc1 no message", publisher._core.support.encode(String(data="x"))]
