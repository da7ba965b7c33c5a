"""A program of rclpy's AsyncNode with std_msgs/String: the same work as `bus_string` with the asyncio API.

Messages are made empty and then filled, as in `rclpy_string`.
"""

import asyncio
import sys
from collections.abc import Awaitable
from time import monotonic_ns
from typing import Any

import rclpy
from rclpy.experimental import AsyncNode
from rclpy.qos import HistoryPolicy, QoSProfile
from std_msgs.msg import String

from benchmarks.adapters.roles import LAST, Stamps, stamped
from benchmarks.work import TOPIC, Work, pace, text_of
from benchmarks.worker import Parent, options, run

_LARGE = 1 << 16
_MATCH_S = 0.01
_TURN = 64
"""Number of lossy messages published at a time, before the event loop gets a turn."""


def _qos(work: Work) -> QoSProfile:
    if work.publish_by == LAST:
        return QoSProfile(depth=10)
    if not work.rate or work.size >= _LARGE:
        return QoSProfile(history=HistoryPolicy.KEEP_ALL)
    return QoSProfile(depth=1000)


def _filled(text: str) -> Any:
    message = String()
    message.data = text
    return message


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    async with AsyncNode("bench_publisher") as node:
        pub = node.create_publisher(String, TOPIC, _qos(work))
        while pub.get_subscription_count() < work.subscribers:  # noqa: ASYNC110
            await asyncio.sleep(_MATCH_S)
        parent.tell("ready", route=pub._native.matches[0].route)
        if work.rate:
            await parent.wait_for("go")
            if work.publish_by == "timer":
                await _publish_by_timer(node, pub, work)
            else:
                await pace(lambda text: _publish_or_wait(pub, text), work)
        elif work.publish_by == LAST:
            await parent.wait_for("go")
            await _flood_to_the_last(parent, pub, work)
        else:
            text = text_of(work.size)
            await parent.wait_for("warm_up")
            await _flood(pub, text, work.warm_up)
            await parent.wait_for("go")
            begin_ns = monotonic_ns()
            await _flood(pub, text, work.count)
            parent.tell("sent", begin_ns=begin_ns)
        await asyncio.Event().wait()


def _publish_or_wait(pub: Any, text: str) -> Awaitable[None] | None:
    message = _filled(text)
    try:
        pub.publish(message)
    except RuntimeError:  # there is no room
        return pub.send(message)  # type: ignore[no-any-return]
    return None


async def _publish_by_timer(node: Any, pub: Any, work: Work) -> None:
    left, done = work.total, asyncio.Event()

    def publish() -> None:
        nonlocal left
        pub.publish(_filled(stamped(work)))
        left -= 1
        if not left:
            timer.cancel()
            done.set()

    timer = node.create_timer(1 / work.rate, publish)
    await done.wait()


async def _flood(pub: Any, text: str, count: int) -> None:
    send = pub.send  # it waits for room, and `publish` has no result
    for _ in range(count):
        message = String()  # as `_filled`, without a call that the program of the asyncio API does not have
        message.data = text
        await send(message)


async def _flood_to_the_last(parent: Parent, pub: Any, work: Work) -> None:
    publish, text = pub.publish, text_of(work.size)
    begin_ns = monotonic_ns()
    for number in range(work.count - 1):
        publish(_filled(text))
        if not number % _TURN:
            await asyncio.sleep(0)
    publish(_filled(LAST))
    parent.tell("sent", begin_ns=begin_ns, end_ns=monotonic_ns())


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    async with AsyncNode("bench_subscriber") as node:
        if work.rate:
            await _take_paced(parent, node, work)
        elif work.publish_by == LAST:
            await _take_to_the_last(parent, node, work)
        else:
            await _take_flood(parent, node, work)
        await asyncio.Event().wait()


async def _subscribe(node: Any, work: Work, callback: Any) -> Any:
    sub = node.create_subscription(String, TOPIC, callback, _qos(work))
    while sub._native is None:  # noqa: ASYNC110
        await asyncio.sleep(_MATCH_S)
    return sub


async def _take_flood(parent: Parent, node: Any, work: Work) -> None:
    left, reached = work.warm_up, asyncio.Event()

    def count(message: Any) -> None:
        nonlocal left
        left -= 1
        if not left:
            reached.set()

    sub = await _subscribe(node, work, count)
    parent.tell("ready")
    for event, number in (("warm", work.warm_up), ("received", work.count)):
        left = number
        await reached.wait()
        reached.clear()
        end_ns = monotonic_ns()
        totals = sub._native.statistics()
        parent.tell(event, end_ns=end_ns, count=totals.delivered, dropped=totals.dropped)


async def _take_to_the_last(parent: Parent, node: Any, work: Work) -> None:
    count, ended = 0, asyncio.Event()

    def take(message: Any) -> None:
        nonlocal count
        count += 1
        if message.data == LAST:
            parent.tell("received", end_ns=monotonic_ns(), count=count)
            ended.set()

    await _subscribe(node, work, take)
    parent.tell("ready")
    await ended.wait()


async def _take_paced(parent: Parent, node: Any, work: Work) -> None:
    stamps, complete = Stamps(work), asyncio.Event()

    def note(message: Any) -> None:
        if stamps.note(message.data):
            complete.set()

    await _subscribe(node, work, note)
    parent.tell("ready")
    await complete.wait()
    await stamps.report(parent)


if __name__ == "__main__":
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
