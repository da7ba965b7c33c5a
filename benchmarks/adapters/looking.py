"""The processes of look.py: many busy topics, and `bus top` on a terminal of a given size."""

import asyncio
from argparse import Namespace
from statistics import median
from time import monotonic_ns, perf_counter, process_time

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String
from bus_cli.stream import open_node

_NODES = 20
_PAUSE_S = 0.05
_WARM_UP = 5


class Load(msgspec.Struct, frozen=True, kw_only=True):
    """The number of `topics`, each with a publisher and a subscription, or the number of `looks` at them."""

    topics: int = 0
    looks: int = 0
    size: tuple[int, int] = (160, 50)


async def main(parent: Parent) -> None:
    load: Load = options(Load)
    if load.topics:
        await _talk(parent, load.topics)
    else:
        await _look(parent, load)


async def _talk(parent: Parent, topics: int) -> None:
    """Publish on each topic twice a second, so that all counters change between two looks."""
    async with bus.Node("talker") as talker, bus.Node("listener") as listener:
        names = [f"/robot/part_{number % _NODES}/topic_{number}" for number in range(topics)]
        publishers = [await talker.create_publisher(String, name, 10) for name in names]
        for name in names:
            await listener.create_subscription(String, name, 10, lambda message: None)
        for publisher in publishers:
            await publisher.wait_for_subscriptions()
        parent.tell("ready")
        turn = 0
        while True:
            for publisher in publishers[turn :: int(0.5 / _PAUSE_S)]:
                publisher.publish(String(data="x"))
            turn = (turn + 1) % int(0.5 / _PAUSE_S)
            await asyncio.sleep(_PAUSE_S)


async def _look(parent: Parent, load: Load) -> None:
    from bus_cli.top.screen import Top
    from bus_cli.top.state import State

    async with open_node(Namespace(socket=None, domain=None)) as node:
        state = State()
        top = Top(node, 1.0, state)
        async with top.run_test(size=load.size):
            state.is_paused = True  # from now on this program looks itself
            spent_s = []
            for _ in range(load.looks + _WARM_UP):
                await asyncio.sleep(0.5)
                began_s, used_s = perf_counter(), process_time()
                graph = await node.graph(statistics=True)
                asked_s = perf_counter()
                top._model.take(graph, monotonic_ns())
                state.take(top._model)
                top._show()
                top.screen._compositor.render_strips()
                spent_s.append((asked_s - began_s, perf_counter() - began_s, process_time() - used_s))
    asked_ms, ms, cpu_ms = (median(one) * 1e3 for one in zip(*spent_s[_WARM_UP:], strict=True))
    parent.tell("looked", asked_ms=asked_ms, ms=ms, cpu_ms=cpu_ms)
    await asyncio.Event().wait()


if __name__ == "__main__":
    run(main)
