"""Programs of startup.py: a listener for a talker without stamps, and a program with both."""

import asyncio
import sys
from time import monotonic_ns

import bus
from benchmarks.work import TOPIC
from benchmarks.worker import Parent, run, tell
from bus.msg.std_msgs import String


async def listener(parent: Parent) -> None:
    """Report the arrival of the first message."""
    async with bus.Node("bench_listener") as node:
        sub = await node.create_subscription(String, TOPIC)
        parent.tell("ready")
        async for _ in sub:
            tell("received", at_ns=monotonic_ns())
            break
        await asyncio.Event().wait()


async def alone() -> None:
    """Talker and listener in one program; reports the arrival of the message."""
    async with bus.Node("bench_alone") as node:
        sub = await node.create_subscription(String, TOPIC)
        pub = await node.create_publisher(String, TOPIC)
        pub.publish(String(data="Hello World: 0"))
        async for _ in sub:
            tell("received", at_ns=monotonic_ns())
            break


if __name__ == "__main__":
    match sys.argv[1]:
        case "listener":
            run(listener)
        case "alone":
            bus.run(alone())
