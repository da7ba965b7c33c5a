"""busd's socket route: std_msgs/String from a publisher's process over busd to a subscriber's process."""

import asyncio
import sys
from time import monotonic_ns

import msgspec

import bus
from benchmarks.work import TOPIC, Work, arrivals, pace, text_of
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

_LOSSLESS = bus.QoSProfile(history="keep_all")
_PACED = bus.QoSProfile(depth=1000)
"""A second of messages: a process that the scheduler forgets for a while loses none."""


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    async with bus.Node("bench_publisher") as node:
        pub = await node.create_publisher(String, TOPIC, _PACED if work.rate else _LOSSLESS)
        await pub.wait_for_subscriptions()
        parent.tell("ready")
        if work.rate:
            await parent.wait_for("go")
            await pace(lambda text: pub.publish(String(data=text)), work)
            await pub.flush()
            return
        flood = _flood_by_send if work.publish_by == "send" else _flood_by_publish
        text = text_of(work.size)
        await parent.wait_for("warm_up")
        await flood(pub, text, work.warm_up)
        await parent.wait_for("go")
        begin_ns = monotonic_ns()
        await flood(pub, text, work.count)
        parent.tell("sent", begin_ns=begin_ns)
        await asyncio.Event().wait()


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
        else:
            await _take_flood(parent, node, work)


async def _take_flood(parent: Parent, node: bus.Node, work: Work) -> None:
    left, reached = work.warm_up, asyncio.Event()

    def count(message: String) -> None:
        nonlocal left
        left -= 1
        if not left:
            reached.set()

    by_callback = work.take_by == "callback"
    sub = await node.create_subscription(String, TOPIC, _LOSSLESS, count if by_callback else None)
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
    await asyncio.Event().wait()


async def _take_paced(parent: Parent, node: bus.Node, work: Work) -> None:
    total = work.warm_up + work.count
    arrived_ns: list[int] = []
    texts: list[str] = []
    complete = asyncio.Event()

    def note(message: String) -> None:
        arrived_ns.append(monotonic_ns())
        texts.append(message.data)
        if len(texts) == total:
            complete.set()

    by_callback = work.take_by == "callback"
    sub = await node.create_subscription(String, TOPIC, _PACED, note if by_callback else None)
    parent.tell("ready")
    if by_callback:
        await complete.wait()
    else:
        async for message in sub:
            note(message)
            if len(texts) == total:
                break
    parent.tell("received", **msgspec.to_builtins(arrivals(texts, arrived_ns, work)))
    await asyncio.Event().wait()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
