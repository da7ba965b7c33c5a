"""busd with std_msgs/String from one process to several, at full speed and without waiting for
subscribers."""

import asyncio
import sys
from time import monotonic_ns, process_time_ns

import msgspec

import bus
from benchmarks.work import TOPIC, text_of
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

_TURN = 64
"""Number of messages published at a time, before the event loop gets a turn."""
_END = "the end"
_ACCOUNTS_S = 5.0
_LOOK_S = 0.02


class Fan(msgspec.Struct, frozen=True, kw_only=True):
    """`count` messages of `size` characters and a last message, to each of `subscribers`."""

    size: int
    count: int
    subscribers: int
    depth: int = 1000

    @property
    def qos(self) -> bus.QoSProfile:
        return bus.QoSProfile(depth=self.depth, reliability="best_effort")


async def publisher(parent: Parent) -> None:
    fan: Fan = options(Fan)
    async with bus.Node("bench_publisher") as node:
        pub = await node.create_publisher(String, TOPIC, fan.qos)
        await pub.wait_for_subscriptions(fan.subscribers)
        parent.tell("ready", route=",".join({match.route for match in pub.matches}))
        await parent.wait_for("go")
        publish, text = pub.publish, text_of(fan.size)
        begin_ns, begin_cpu_ns = monotonic_ns(), process_time_ns()
        for number in range(fan.count):
            publish(String(data=text))
            if not number % _TURN:
                await asyncio.sleep(0)
        await pub.send(String(data=_END))
        await pub.flush()
        parent.tell("sent", begin_ns=begin_ns, cpu_ns=process_time_ns() - begin_cpu_ns)
        await asyncio.Event().wait()


async def subscriber(parent: Parent) -> None:
    fan: Fan = options(Fan)
    end_ns, ended = 0, asyncio.Event()

    def look(message: String) -> None:
        nonlocal end_ns
        if message.data == _END:
            end_ns = monotonic_ns()
            ended.set()

    async with bus.Node("bench_subscriber") as node:
        sub = await node.create_subscription(String, TOPIC, fan.qos, look)
        parent.tell("ready")
        await ended.wait()
        totals = sub.statistics()
        # busd reports its dropped messages a moment later.
        deadline_ns = monotonic_ns() + int(_ACCOUNTS_S * 1e9)
        while totals.delivered + sum(totals.dropped.values()) <= fan.count and monotonic_ns() < deadline_ns:
            await asyncio.sleep(_LOOK_S)
            totals = sub.statistics()
        parent.tell("received", end_ns=end_ns, count=totals.delivered, dropped=totals.dropped)
        await asyncio.Event().wait()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
