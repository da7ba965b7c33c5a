"""busd with a message of one field of bytes: copied in and out, or loaned and viewed.

With `publish_by` "loan", the publisher fills a slot in its ring, once. With `take_by` "views", the subscriber
reads the message there. It only reads the head, like a program that passes the rest on.
"""

import asyncio
import sys
from collections.abc import Awaitable
from time import monotonic_ns

import msgspec

import bus
from benchmarks.adapters.bus_string import fail
from benchmarks.adapters.roles import Stamps
from benchmarks.work import HEAD, TOPIC, Work, pace, text_of
from benchmarks.worker import Parent, options, run

_LOSSLESS = bus.QoSProfile(history="keep_all")


class Frame(msgspec.Struct):
    """A frame like a camera's, without a header."""

    data: bytes = b""


class Feeder:
    """Publishes frames of one size. Each loaned frame is filled by one copy of the same bytes."""

    def __init__(self, pub: bus.Publisher[Frame], work: Work) -> None:
        self._pub = pub
        self._body = text_of(work.size).encode()
        self._by_loan = work.publish_by == "loan"
        self.size = HEAD if self._by_loan else work.size  # size of the bytes made for each frame

    def feed(self, data: bytes) -> bool:
        """Publish a frame with `data`. A loaned frame only begins with it."""
        if not self._by_loan:
            return self._pub.publish(Frame(data=data))
        loan = self._pub.loan(Frame(), "data", len(self._body))
        if loan is None:
            return False
        buffer = loan.buffer
        buffer[:] = self._body
        buffer[: len(data)] = data
        return loan.publish()

    def feed_or_wait(self, data: bytes) -> Awaitable[None] | None:
        """As `feed`; without room, returns an awaitable that waits for room."""
        return None if self.feed(data) else self._pub.send(Frame(data=data + self._body[len(data) :]))

    async def flood(self, count: int) -> None:
        """Publish `count` frames. Without room, send one more by copy, which waits for room."""
        feed, data = self.feed, b"" if self._by_loan else self._body
        for _ in range(count):
            if not feed(data):
                await self._pub.send(Frame(data=self._body))


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    async with bus.Node("bench_publisher") as node:
        pub = await node.create_publisher(Frame, TOPIC, _LOSSLESS)
        feeder = Feeder(pub, work)
        await pub.wait_for_subscriptions(work.subscribers)
        parent.tell("ready", route=pub.matches[0].route)
        if work.rate:
            await parent.wait_for("go")
            await pace(feeder.feed_or_wait, msgspec.structs.replace(work, size=feeder.size), bytes)
            await pub.flush()
        else:
            await parent.wait_for("warm_up")
            await feeder.flood(work.warm_up)
            await parent.wait_for("go")
            begin_ns = monotonic_ns()
            await feeder.flood(work.count)
            parent.tell("sent", begin_ns=begin_ns)
        await asyncio.Event().wait()


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    stamps, reached = Stamps(work), asyncio.Event()
    left = work.warm_up

    def note(message: Frame) -> None:
        if stamps.note(bytes(message.data[:HEAD])):
            reached.set()

    def count(message: Frame) -> None:
        nonlocal left
        left -= message.data[0] > 0
        if not left:
            reached.set()

    async with bus.Node("bench_subscriber") as node:
        sub = await node.create_subscription(
            Frame,
            TOPIC,
            _LOSSLESS,
            note if work.rate else count,
            busy_poll=work.busy_poll_s,
            events=bus.SubscriptionEvents(message_lost=fail),
            views=work.take_by == "views",
        )
        parent.tell("ready")
        if work.rate:
            await stamps.report_when(reached.wait(), parent)
        else:
            for event, number in (("warm", work.count), ("received", 0)):
                await reached.wait()
                reached.clear()
                end_ns = monotonic_ns()
                left += number
                totals = sub.statistics()
                parent.tell(event, end_ns=end_ns, count=totals.delivered, dropped=totals.dropped)
        await asyncio.Event().wait()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
