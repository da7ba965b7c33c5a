"""The processes of growth.py: a paced stream over many topics, nodes or subscriptions; many declarations."""

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import cycle
from time import monotonic_ns

import msgspec

import bus
from benchmarks.adapters.roles import Stamps
from benchmarks.work import Work, pace
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

_BEHIND_S = 2.0
_LEAST_DEPTH, _MOST_DEPTH = 100, 10_000


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """`rate` messages a second in total over `topics` in turn, each with a number of `subscriptions`.

    The subscriptions are spread over `processes`. The publishers and subscriptions of a process belong to its
    `nodes`. If `endpoints` is set, one process only makes that many endpoints: half of them publishers, which
    match the other half.
    """

    topics: int = 1
    nodes: int = 1
    subscriptions: int = 1
    processes: int = 1
    rate: float = 1000.0
    seconds: float = 0.5
    size: int = 64
    endpoints: int = 0

    @property
    def count(self) -> int:
        """Number of measured messages."""
        return max(1, int(self.rate * self.seconds))

    @property
    def warm_up(self) -> int:
        """Number of messages before the measured ones: each topic gets some."""
        return self.topics * max(1, 100 // self.topics)

    @property
    def in_each(self) -> int:
        """Number of subscriptions of a topic in one process."""
        return self.subscriptions // self.processes

    @property
    def depth(self) -> int:
        """Enough to lose no message if the scheduler does not run a process for a while."""
        return max(_LEAST_DEPTH, min(_MOST_DEPTH, int(self.rate * _BEHIND_S / self.topics)))

    def work(self, times: int = 1) -> Work:
        """The paced work. A process that takes each message several times has `times` as many messages."""
        return Work(size=self.size, count=self.count * times, warm_up=0, rate=self.rate)


@asynccontextmanager
async def _nodes(role: str, load: Load) -> AsyncIterator[list[bus.Node]]:
    async with AsyncExitStack() as stack:
        yield [
            await stack.enter_async_context(bus.Node(f"bench_{role}_{index}")) for index in range(load.nodes)
        ]


async def publisher(parent: Parent) -> None:
    load: Load = options(Load)
    async with _nodes("publisher", load) as nodes:
        pubs = [
            await nodes[index % load.nodes].create_publisher(String, f"bench_{index}", load.depth)
            for index in range(load.topics)
        ]
        for pub in pubs:
            await pub.wait_for_subscriptions(load.subscriptions)
        parent.tell("ready", route=",".join({match.route for pub in pubs for match in pub.matches}))
        await parent.wait_for("warm_up")
        turns = cycle(pubs)
        for _ in range(load.warm_up):
            next(turns).publish(String(data="warm-up"))
            await asyncio.sleep(0)
        await parent.wait_for("go")
        # No flush: a thousand of them would distort the measurement, and the loop runs until all messages are
        # sent.
        await pace(lambda text: next(turns).publish(String(data=text)), load.work())
        await asyncio.Event().wait()


async def subscriber(parent: Parent) -> None:
    load: Load = options(Load)
    stamps, complete = Stamps(load.work(load.in_each)), asyncio.Event()
    cold = load.warm_up * load.in_each

    def note(message: String) -> None:
        nonlocal cold
        if cold:
            cold -= 1
            if not cold:
                parent.tell("warm")
        elif stamps.note(message.data):
            complete.set()

    async with _nodes("subscriber", load) as nodes:
        for index in range(load.topics):
            for _ in range(load.in_each):
                node = nodes[index % load.nodes]
                await node.create_subscription(String, f"bench_{index}", load.depth, note)
        parent.tell("ready")
        await complete.wait()
        await stamps.report(parent)


async def declarer(parent: Parent) -> None:
    load: Load = options(Load)
    names = [f"bench_{index}" for index in range(load.endpoints // 2)]
    async with bus.Node("bench_declarer") as node:
        first = await node.create_publisher(String, "first")
        await node.create_subscription(String, "first", callback=_ignore)
        await first.wait_for_subscriptions()  # loads and makes everything that endpoints share
        parent.tell("ready", route=first.matches[0].route)
        await parent.wait_for("go")
        begin_ns = monotonic_ns()
        pubs = [await node.create_publisher(String, name) for name in names]
        for name in names:
            await node.create_subscription(String, name, callback=_ignore)
        for pub in pubs:
            await pub.wait_for_subscriptions()
        parent.tell("declared", took_ns=monotonic_ns() - begin_ns)
        await asyncio.Event().wait()


def _ignore(message: String) -> None:
    """Never called: nothing is published."""


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber, "declarer": declarer}[sys.argv[1]])
