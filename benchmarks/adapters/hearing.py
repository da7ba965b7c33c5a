"""A process of launching.py: subscribes to launched nodes, and reports when it has a message of each."""

import asyncio
from time import monotonic_ns

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String


class Heard(msgspec.Struct, frozen=True):
    """The number of nodes. Each publishes a different text on the topic."""

    topic: str
    nodes: int


async def main(parent: Parent) -> None:
    wanted: Heard = options(Heard)
    heard: set[str] = set()
    async with bus.Node("hearing") as node:
        subscription = await node.create_subscription(String, wanted.topic, 100)
        parent.tell("ready")
        async for message in subscription:
            heard.add(message.data)
            if len(heard) == wanted.nodes:
                break
        parent.tell("heard", heard_ns=monotonic_ns())
        await asyncio.Event().wait()


if __name__ == "__main__":
    run(main)
