"""Delivery by one native call and delivery step by step: different subscriptions together, odd callbacks."""

import asyncio
import os
import random
import threading
from collections.abc import Callable
from typing import Any

import pytest

import bus
from bus.msg.std_msgs import UInt64
from conftest import WAIT_S
from semantics import KEEP_ALL, accounted, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("daemon")

DEEP = bus.QoSProfile(5000)
KINDS = ("plain", "plain", "info", "async", "deadline", "lost", "keep all", "taken", "late", "shallow")
ROUNDS = 120


class Ear:
    """A subscription of the given kind, and the messages that it received."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.heard: list[int] = []
        self.lost = 0
        self._is_called = False
        self._iterating: asyncio.Task[None] | None = None
        self.subscription: bus.Subscription[UInt64]

    async def open(self, node: bus.Node) -> None:
        callbacks: dict[str, Callable[..., object] | None] = {
            "info": self.with_info,
            "async": self.slowly,
            "taken": None,
            "late": self.late,
        }
        qos = DEEP
        if self.kind == "deadline":
            qos = bus.QoSProfile(5000, deadline=60.0)
        elif self.kind == "keep all":
            qos = KEEP_ALL
        elif self.kind == "shallow":
            qos = bus.QoSProfile(1)
        events = bus.SubscriptionEvents(message_lost=self.count) if self.kind in ("lost", "shallow") else None
        self.subscription = await node.create_subscription(
            UInt64, "mixed", qos, callbacks.get(self.kind, self), events=events
        )
        if self.kind == "taken":
            self._iterating = asyncio.create_task(self.iterate())

    async def close(self) -> None:
        await self.subscription.close()
        if self._iterating is not None:
            await self._iterating

    def __call__(self, message: UInt64) -> None:
        assert not self._is_called, "calls overlap"
        self._is_called = True
        self.heard.append(message.data)
        self._is_called = False

    def with_info(self, message: UInt64, info: bus.MessageInfo) -> None:
        assert info.reception_sequence_number == len(self.heard) + 1
        self(message)

    async def slowly(self, message: UInt64) -> None:
        assert not self._is_called, "calls overlap"
        self._is_called = True
        await asyncio.sleep(0)
        self._is_called = False
        self(message)

    def late(self, message: UInt64) -> None:
        """Uses up its turn now and then, so that delivery continues in the next one."""
        self(message)
        if message.data % 200 == 0:
            end = asyncio.get_running_loop().time() + 0.006
            while asyncio.get_running_loop().time() < end:
                pass

    async def iterate(self) -> None:
        async for message in self.subscription:
            self(message)

    def count(self, event: bus.MessageLost) -> None:
        self.lost = event.total_count


@pytest.mark.parametrize("seed", range(6))
async def test_order_and_counters_hold_whatever_is_beside(node: bus.Node, route: str, seed: int) -> None:
    rng = random.Random(seed)
    history = "keep_all" if seed % 2 else "keep_last"
    offered = bus.QoSProfile(DEEP.depth, history=history, deadline=50.0)
    publisher = await node.create_publisher(UInt64, "mixed", offered)
    ears: list[tuple[Ear, int]] = []
    number = 0
    for _ in range(ROUNDS):
        what = rng.random()
        if what < 0.15 or len(ears) < 3:
            ear = Ear(rng.choice(KINDS))
            await ear.open(node)
            ears.append((ear, number))
        elif what < 0.2 and len(ears) > 8:
            ear, _ = ears.pop(rng.randrange(len(ears)))
            await ear.close()
        else:
            for _ in range(rng.choice((1, 1, 1, 2, 30))):
                await publisher.send(UInt64(data=number))
                number += 1
        await asyncio.sleep(rng.choice((0, 0, 0.002)))
    last = number
    await publisher.send(UInt64(data=last))
    await until(lambda: all(ear.heard and ear.heard[-1] == last for ear, _ in ears))
    for ear, first in ears:
        if ear.kind != "shallow":
            assert ear.heard == list(range(first, last + 1)), ear.kind
            assert not ear.subscription.statistics().dropped
        assert ear.heard == sorted(set(ear.heard))
        assert len(ear.heard) == ear.subscription.statistics().delivered
        assert accounted(ear.subscription) == ear.subscription.statistics().expected == last + 1 - first
        assert ear.lost == sum(ear.subscription.statistics().dropped.values()) or ear.kind != "shallow"
        await ear.close()


async def test_losses_are_told_also_where_nothing_else_is_to_be_done(node: bus.Node, route: str) -> None:
    ear = Ear("shallow")
    await ear.open(node)
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    for round_ in range(1, 6):
        for number in range(4):
            publisher.publish(UInt64(data=10 * round_ + number))
        await until(lambda last=10 * round_ + 3: ear.heard and ear.heard[-1] == last)
        await until(lambda: accounted(ear.subscription) == ear.subscription.statistics().expected)
        assert ear.lost == sum(ear.subscription.statistics().dropped.values())
        publisher.publish(UInt64(data=10 * round_ + 5))  # one alone, and none lost
        await until(lambda last=10 * round_ + 5: ear.heard[-1] == last)
    assert ear.lost


async def test_the_graph_hears_of_what_is_delivered_one_by_one(node: bus.Node, route: str) -> None:
    ear = Ear("plain")
    await ear.open(node)
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)

    async def counted() -> int:
        graph = await node.graph(statistics=True)
        return next(one.statistics.samples for one in graph.subscriptions if one.topic == "/mixed")

    for expected in (3, 6):
        for _ in range(3):
            publisher.publish(UInt64())
            await asyncio.sleep(0.01)
        async with asyncio.timeout(WAIT_S):
            while await counted() != expected:  # noqa: ASYNC110
                await asyncio.sleep(0.05)


@pytest.mark.parametrize("is_plain", [True, False])
async def test_a_cancelled_error_of_a_callback_does_not_end_delivery(
    node: bus.Node, route: str, is_plain: bool
) -> None:
    heard: list[int] = []
    told: list[dict[str, Any]] = []

    def callback(message: UInt64) -> None:
        heard.append(message.data)
        if message.data == 1:
            raise asyncio.CancelledError

    def with_info(message: UInt64, info: bus.MessageInfo) -> None:
        callback(message)

    loop = asyncio.get_running_loop()
    before = loop.get_exception_handler()
    loop.set_exception_handler(lambda _, context: told.append(context))
    try:
        await node.create_subscription(UInt64, "mixed", 10, callback if is_plain else with_info)
        publisher = await node.create_publisher(UInt64, "mixed", 10)
        for number in range(1, 4):
            publisher.publish(UInt64(data=number))
            await until(lambda count=number: len(heard) == count)
    finally:
        loop.set_exception_handler(before)
    assert heard == [1, 2, 3]
    assert len(told) == 1


@pytest.mark.parametrize("depth", [2, 100])
async def test_what_came_with_the_message_of_a_cancelled_error_is_delivered(
    node: bus.Node, route: str, depth: int
) -> None:
    """Also to other subscriptions, and if the receiver had to be emptied during delivery."""
    heard: dict[str, list[int]] = {"bad": [], "good": []}
    told: list[dict[str, Any]] = []

    def bad(message: UInt64) -> None:
        heard["bad"].append(message.data)
        if message.data % 3 == 1:
            raise asyncio.CancelledError

    loop = asyncio.get_running_loop()
    before = loop.get_exception_handler()
    loop.set_exception_handler(lambda _, context: told.append(context))
    try:
        publishers = []
        for name, callback in (("bad", bad), ("good", lambda message: heard["good"].append(message.data))):
            await node.create_subscription(UInt64, name, depth, callback)
            publishers.append(await node.create_publisher(UInt64, name, 100))
        for publisher in publishers:
            await publisher.wait_for_subscriptions()
        for number in range(20):
            for publisher in publishers:
                publisher.publish(UInt64(data=number))
        await until(lambda: all(numbers and numbers[-1] == 19 for numbers in heard.values()))
        for publisher in publishers:
            publisher.publish(UInt64(data=20))
        await until(lambda: all(numbers[-1] == 20 for numbers in heard.values()))
    finally:
        loop.set_exception_handler(before)
    assert told
    if depth == 100:
        assert heard == {"bad": [*range(21)], "good": [*range(21)]}


async def test_a_callback_may_close_publish_and_fork(node: bus.Node, route: str) -> None:
    heard: list[int] = []
    closing: list[asyncio.Task[None]] = []

    def callback(message: UInt64) -> None:
        heard.append(message.data)
        if message.data == 1:
            publisher.publish(UInt64(data=2))
        elif message.data == 2:
            if (child := os.fork()) == 0:
                os._exit(0)
            os.waitpid(child, 0)
            publisher.publish(UInt64(data=3))
        elif message.data == 3:
            closing.append(asyncio.ensure_future(subscription.close()))
            publisher.publish(UInt64(data=4))

    subscription = await node.create_subscription(UInt64, "mixed", 10, callback)
    other = Ear("plain")
    await other.open(node)
    publisher = await node.create_publisher(UInt64, "mixed", 10)
    publisher.publish(UInt64(data=1))
    async with asyncio.timeout(WAIT_S):
        await until(lambda: closing and other.heard == [1, 2, 3, 4])
        await closing[0]
    publisher.publish(UInt64(data=5))
    await until(lambda: other.heard[-1] == 5)
    assert heard in ([1, 2, 3], [1, 2, 3, 4])


async def test_a_task_that_is_cancelled_as_a_message_comes_loses_none(node: bus.Node, route: str) -> None:
    """Whichever comes first in the turn of the loop; the message keeps its number and its publisher."""
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    subscription = await node.create_subscription(UInt64, "mixed", DEEP)
    await until(lambda: len(publisher.matches) == 1)
    received: list[tuple[int, bus.MessageInfo]] = []
    rng = random.Random(7)

    async def receive() -> None:
        message, info = await subscription.receive()
        received.append((message.data, info))

    number = 0
    while number < 300:
        task = asyncio.create_task(receive())
        await asyncio.sleep(0)
        publisher.publish(UInt64(data=number))
        number += 1
        for _ in range(rng.randrange(5)):
            await asyncio.sleep(0)
        task.cancel()
        await asyncio.wait([task])
    while len(received) < number:
        async with asyncio.timeout(WAIT_S):
            await receive()
    assert [data for data, _ in received] == [*range(number)]
    assert [info.publication_sequence_number for _, info in received] == [*range(1, number + 1)]
    assert [info.reception_sequence_number for _, info in received] == [*range(1, number + 1)]
    assert {info.publisher_gid for _, info in received} == {publisher.gid}
    assert accounted(subscription) == number


@pytest.mark.parametrize("tasks", [1, 2])
async def test_a_message_can_be_taken_until_its_task_has_it(node: bus.Node, route: str, tasks: int) -> None:
    """A program that cancels its tasks, and does not wait for them, takes all messages in order."""
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    subscription = await node.create_subscription(UInt64, "mixed", DEEP)
    await until(lambda: len(publisher.matches) == 1)
    taken: list[tuple[UInt64, bus.MessageInfo]] = []
    number = 0
    for round_ in range(60):
        receiving = [asyncio.create_task(subscription.receive()) for _ in range(tasks)]
        await asyncio.sleep(0)
        for turns in (round_ % 4, round_ % 3, 0):
            publisher.publish(UInt64(data=number))
            number += 1
            for _ in range(turns):
                await asyncio.sleep(0)
        taken += [task.result() for task in receiving if task.done()]
        for task in receiving:
            task.cancel()
        taken += subscription.take_many(1000)
        for result in await asyncio.gather(*receiving, return_exceptions=True):
            assert isinstance(result, asyncio.CancelledError) or result in taken
    async with asyncio.timeout(WAIT_S):
        while len(taken) < number:
            taken.append(await subscription.receive())
    assert [message.data for message, _ in taken] == [*range(number)]
    assert [info.reception_sequence_number for _, info in taken] == [*range(1, number + 1)]
    assert accounted(subscription) == number


async def test_a_task_of_another_loop_loses_no_message(node: bus.Node, route: str) -> None:
    """It is refused; meanwhile a message may have come for it."""
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    subscription = await node.create_subscription(UInt64, "mixed", DEEP)
    await until(lambda: len(publisher.matches) == 1)

    async def receive(waits: threading.Event, published: threading.Event) -> None:
        def block() -> None:
            """Called when the task waits, before it learns of its mistake."""
            waits.set()
            published.wait(WAIT_S)

        asyncio.get_running_loop().call_soon(block)
        await subscription.receive()

    for number in range(5):
        waits, published = threading.Event(), threading.Event()
        refused = asyncio.create_task(asyncio.to_thread(asyncio.run, receive(waits, published)))
        await asyncio.to_thread(waits.wait)
        publisher.publish(UInt64(data=number))
        published.set()
        with pytest.raises(bus.LocalProtocolError, match="another event loop"):
            await refused
        async with asyncio.timeout(WAIT_S):
            assert (await subscription.receive())[0].data == number


async def test_a_task_that_waits_takes_nothing_from_a_callback(node: bus.Node, route: str) -> None:
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    heard: list[int] = []
    subscription = await node.create_subscription(
        UInt64, "mixed", DEEP, lambda message: heard.append(message.data)
    )
    await until(lambda: len(publisher.matches) == 1)
    task = asyncio.create_task(subscription.receive())
    for number in range(5):
        await asyncio.sleep(0)
        publisher.publish(UInt64(data=number))
        await until(lambda: accounted(subscription) == len(heard) > 0)
    await until(lambda: heard == [*range(5)])
    assert not task.done()
    task.cancel()


async def test_tasks_get_messages_again_after_a_callback_of_arrivals(node: bus.Node, route: str) -> None:
    publisher = await node.create_publisher(UInt64, "mixed", DEEP)
    subscription = await node.create_subscription(UInt64, "mixed", DEEP)
    await until(lambda: len(publisher.matches) == 1)
    for first in (0, 3, 6):
        task = asyncio.create_task(subscription.receive())
        await asyncio.sleep(0)
        publisher.publish(UInt64(data=first))
        assert (await task)[0].data == first
        arrived: list[None] = []
        subscription.set_arrival_callback(lambda arrived=arrived: arrived.append(None))  # type: ignore[misc]
        task = asyncio.create_task(subscription.receive())
        await asyncio.sleep(0)
        publisher.publish(UInt64(data=first + 1))
        await until(lambda arrived=arrived: arrived)  # type: ignore[misc]
        assert [message.data for message, _ in subscription.take_many(9)] == [first + 1]
        assert not task.done()
        subscription.set_arrival_callback(None)
        publisher.publish(UInt64(data=first + 2))
        assert (await task)[0].data == first + 2
