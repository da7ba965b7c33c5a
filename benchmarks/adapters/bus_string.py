"""busd with std_msgs/String, by the route that the environment names."""

import asyncio
import sys
from collections.abc import Awaitable
from functools import partial
from time import monotonic_ns
from typing import Any

import bus
from benchmarks.adapters.roles import LAST, Stamps, stamped
from benchmarks.work import AT_ONCE, Work, pace, text_of
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

LARGE = 1 << 16
"""From this size on, in bytes, a publisher waits for late subscriptions, and keeps few messages."""
_FEW, _PAUSE_S = 10, 0.001
_TURN = 64
"""Number of lossy messages published at a time, before the event loop gets a turn."""


def qos_of(work: Work) -> bus.QoSProfile:
    """The QoS of both ends of a measurement."""
    if work.publish_by == LAST:
        return bus.QoSProfile(depth=10)
    if not work.rate or work.size >= LARGE:
        return bus.QoSProfile(history="keep_all")
    # Enough to lose no message if the scheduler does not run a process for a while.
    return bus.QoSProfile(depth=work.depth)


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    async with bus.Node("bench_publisher") as node:
        pub = await node.create_publisher(String, work.topic, qos_of(work))
        await pub.wait_for_subscriptions(work.subscribers)
        if work.publish_by == AT_ONCE:
            pub.publish(String(data=stamped(work)))
            parent.tell("ready")
            await asyncio.Event().wait()
        if work.prefill:
            await _prefill(pub, work)
        parent.tell("ready", route=pub.matches[0].route)
        if work.rate and work.publish_by == "timer":
            await parent.wait_for("go")
            await _publish_by_timer(node, pub, work)
        elif work.rate:
            await parent.wait_for("go")
            await pace(partial(_publish_or_wait, pub), work)
            await pub.flush()
        elif work.publish_by == LAST:
            await parent.wait_for("go")
            await _flood_to_the_last(parent, pub, work)
        else:
            flood = _flood_by_send if work.publish_by == "send" else _flood_by_publish
            text = text_of(work.size)
            await parent.wait_for("warm_up")
            await flood(pub, text, work.warm_up)
            await parent.wait_for("go")
            begin_ns = monotonic_ns()
            await flood(pub, text, work.count)
            parent.tell("sent", begin_ns=begin_ns)
        await asyncio.Event().wait()


async def _prefill(pub: bus.Publisher[String], work: Work) -> None:
    for number in range(work.prefill):
        pub.publish(String(data=text_of(work.size)))
        if not number % _FEW:
            await asyncio.sleep(_PAUSE_S)
    pub.publish(String(data=LAST))


def _publish_or_wait(pub: bus.Publisher[String], text: str) -> Awaitable[None] | None:
    message = String(data=text)
    return None if pub.publish(message) else pub.send(message)


async def _publish_by_timer(node: bus.Node, pub: bus.Publisher[String], work: Work) -> None:
    left, done = work.total, asyncio.Event()

    def publish() -> None:
        nonlocal left
        pub.publish(String(data=stamped(work)))
        left -= 1
        if not left:
            timer.cancel()
            done.set()

    timer = node.create_timer(1 / work.rate, publish)
    await done.wait()


async def _flood_to_the_last(parent: Parent, pub: bus.Publisher[String], work: Work) -> None:
    publish, text = pub.publish, text_of(work.size)
    begin_ns = monotonic_ns()
    for number in range(work.count - 1):
        publish(String(data=text))
        if not number % _TURN:
            await asyncio.sleep(0)
    publish(String(data=LAST))
    parent.tell("sent", begin_ns=begin_ns, end_ns=monotonic_ns())


async def _flood_by_publish(pub: bus.Publisher[String], text: str, count: int) -> None:
    publish = pub.publish
    for _ in range(count):
        if not publish(String(data=text)):
            await pub.send(String(data=text))


async def _flood_by_send(pub: bus.Publisher[String], text: str, count: int) -> None:
    for _ in range(count):
        await pub.send(String(data=text))


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    async with bus.Node("bench_subscriber") as node:
        if work.rate:
            await _take_paced(parent, node, work)
        elif work.publish_by == LAST:
            await _take_to_the_last(parent, node, work)
        else:
            await _take_flood(parent, node, work)
        await asyncio.Event().wait()


async def _take_flood(parent: Parent, node: bus.Node, work: Work) -> None:
    left, reached = work.warm_up, asyncio.Event()

    def count(message: String) -> None:
        nonlocal left
        left -= 1
        if not left:
            reached.set()

    by_callback = work.take_by == "callback"
    sub = await node.create_subscription(
        String, work.topic, qos_of(work), count if by_callback else None, busy_poll=work.busy_poll_s
    )
    parent.tell("ready")
    for event, number in (("warm", work.warm_up), ("received", work.count)):
        left = number
        if by_callback:
            await reached.wait()
            reached.clear()
        else:
            async for _ in sub:
                left -= 1
                if not left:
                    break
        end_ns = monotonic_ns()
        totals = sub.statistics()
        parent.tell(event, end_ns=end_ns, count=totals.delivered, dropped=totals.dropped)


async def _take_to_the_last(parent: Parent, node: bus.Node, work: Work) -> None:
    count, ended = 0, asyncio.Event()

    def take(message: String) -> None:
        nonlocal count
        count += 1
        if message.data == LAST:
            parent.tell("received", end_ns=monotonic_ns(), count=count)
            ended.set()

    await node.create_subscription(String, work.topic, qos_of(work), take)
    parent.tell("ready")
    await ended.wait()


def fail(lost: bus.MessageLost) -> None:
    """End this program if a message was lost that must not be lost."""
    raise RuntimeError(f"lost: {lost.reasons}")


async def _take_paced(parent: Parent, node: bus.Node, work: Work) -> None:
    stamps, complete = Stamps(work), asyncio.Event()
    is_filling = bool(work.prefill)

    def note(message: String) -> None:
        nonlocal is_filling
        if is_filling:
            if message.data == LAST:
                is_filling = False
                parent.tell("warm")
        elif stamps.note(message.data):
            complete.set()

    def lose(lost: bus.MessageLost) -> None:
        if not is_filling:
            fail(lost)

    ways: Any = {"busy_poll": work.busy_poll_s, "events": bus.SubscriptionEvents(message_lost=lose)}
    if work.take_by == "callback":
        await node.create_subscription(String, work.topic, qos_of(work), note, **ways)
        parent.tell("ready")
        await complete.wait()
    else:
        sub = await node.create_subscription(String, work.topic, qos_of(work), **ways)
        parent.tell("ready")
        async for message in sub:
            note(message)
            if complete.is_set():
                break
    await stamps.report(parent)


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
