"""Processes of bridge.py and fleet.py: many endpoints, and messages that may be lost."""

import asyncio
import sys

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String
from bus.msg.std_msgs import UInt8MultiArray as Bytes

_EACH = 20
"""Endpoints of each node."""


class Crowd(msgspec.Struct, frozen=True):
    """The number of endpoints, each on a topic with `prefix`: publishers only, or `both` kinds in turn."""

    endpoints: int
    prefix: str
    both: bool = True


class Torrent(msgspec.Struct, frozen=True):
    """Messages of `size` bytes, `rate` a second, on `topic`, reliable and with a history of `depth`."""

    topic: str
    size: int
    rate: float
    depth: int = 10


def _hear(message: object) -> None:
    """Does nothing: the subscription only has to exist."""


async def crowd(parent: Parent) -> None:
    """Make the endpoints, say `made`, and stay."""
    what: Crowd = options(Crowd)
    parent.tell("ready")
    await parent.wait_for("go")
    name = what.prefix.strip("/").replace("/", "_")
    nodes: list[bus.Node] = []
    for number in range(what.endpoints):
        if number % _EACH == 0:
            nodes.append(await bus.Node(f"{name}_{number // _EACH}", rosout=False).__aenter__())
        topic = f"{what.prefix}/topic_{number}"
        if what.both and number % 2:
            await nodes[-1].create_subscription(String, topic, 10, _hear)
        else:
            await nodes[-1].create_publisher(String, topic, 10)
    parent.tell("made")
    await asyncio.Event().wait()


async def torrent(parent: Parent) -> None:
    """Publish from the word `go` on, with or without subscriptions."""
    what: Torrent = options(Torrent)
    async with bus.Node("torrent", rosout=False) as node:
        publisher = await node.create_publisher(Bytes, what.topic, what.depth)
        await publisher.wait_for_subscriptions()
        parent.tell("ready")
        await parent.wait_for("go")
        loop = asyncio.get_running_loop()
        begin, data = loop.time(), bytes(what.size)
        for number in range(1 << 40):
            publisher.publish(Bytes(data=data))
            await asyncio.sleep(max(0.0, begin + number / what.rate - loop.time()))


async def sink(parent: Parent) -> None:
    """Subscribe to a torrent, and say `flows` at its first message."""
    what: Torrent = options(Torrent)
    flows = asyncio.Event()
    async with bus.Node("sink", rosout=False) as node:
        await node.create_subscription(Bytes, what.topic, what.depth, lambda message: flows.set())
        parent.tell("ready")
        await flows.wait()
        parent.tell("flows")
        await asyncio.Event().wait()


if __name__ == "__main__":
    run({"crowd": crowd, "torrent": torrent, "sink": sink}[sys.argv[1]])
