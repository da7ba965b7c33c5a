"""A process of discovery.py: declares its share of many topics, and reports when all endpoints are
matched."""

import asyncio
from collections.abc import Awaitable
from time import monotonic_ns
from typing import Any

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String


class Share(msgspec.Struct, frozen=True):
    """Process `index` of `processes`, which publish and subscribe to `topics` in total.

    Each topic has one publisher and one subscription, in different processes, and every process subscribes to
    topics of all others. `at_once`: request all endpoints before the first answer, not one by one.
    """

    index: int
    processes: int
    topics: int
    at_once: bool = False

    def published(self) -> list[str]:
        """The topics that this process publishes."""
        return [f"topic_{number}" for number in range(self.index, self.topics, self.processes)]

    def heard(self) -> list[str]:
        """The topics that this process subscribes to."""
        return [
            f"topic_{number}"
            for number in range(self.topics)
            if (number + 1 + number // self.processes % (self.processes - 1)) % self.processes == self.index
        ]


def _hear(message: String) -> None:
    """Never called: nothing is published."""


async def declare(node: bus.Node, share: Share) -> list[Awaitable[None]]:
    """Make all endpoints; returns an awaitable for each, which waits for its match."""
    makers: list[Any] = [node.create_publisher(String, topic) for topic in share.published()]
    makers += [node.create_subscription(String, topic, callback=_hear) for topic in share.heard()]
    made = await asyncio.gather(*makers) if share.at_once else [await maker for maker in makers]
    return [
        one.wait_for_subscriptions() if isinstance(one, bus.Publisher) else one.wait_for_publishers()
        for one in made
    ]


async def main(parent: Parent) -> None:
    share: Share = options(Share)
    parent.tell("ready")
    await parent.wait_for("go")
    async with bus.Node(f"discovery_{share.index}") as node:
        matches = await declare(node, share)
        declared_ns = monotonic_ns()
        for match in matches:
            await match
        parent.tell("matched", declared_ns=declared_ns, matched_ns=monotonic_ns())
        await asyncio.Event().wait()


if __name__ == "__main__":
    run(main)
