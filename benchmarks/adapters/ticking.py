"""A program of asyncio with a periodic timer: a timer of busd, or a new `call_later` for each call.

The calls of `call_later` keep their phase and skip missed periods, as timers of ROS 2 do. If a call is early,
it waits again.
"""

import asyncio
from time import monotonic_ns
from typing import Any

import uvloop

import bus
from benchmarks.ticks import Ticks, Watch
from benchmarks.worker import Parent, options, run


async def by_bus(ticks: Ticks) -> dict[str, Any]:
    """Measure a node's timer."""
    done = asyncio.Event()

    def tick() -> None:
        if watch.note():
            timer.cancel()
            done.set()

    async with bus.Node("ticker", arguments=()) as node:
        node.create_timer(
            1.0, print
        ).cancel()  # this imports the modules for timers, so the next timer starts at once
        watch = Watch(ticks, monotonic_ns() + ticks.period_ns)
        timer = node.create_timer(1 / ticks.rate, tick)
        await done.wait()
        return watch.calls()


async def by_call_later(ticks: Ticks) -> dict[str, Any]:
    """Measure the event loop's own timers."""
    loop, done, period_ns = asyncio.get_running_loop(), asyncio.Event(), ticks.period_ns
    due_ns = monotonic_ns() + period_ns
    watch = Watch(ticks, due_ns)

    def tick() -> None:
        nonlocal due_ns
        now_ns = monotonic_ns()
        if now_ns >= due_ns:
            if watch.note():
                done.set()
                return
            due_ns += ((now_ns - due_ns) // period_ns + 1) * period_ns
        loop.call_later((due_ns - now_ns) / 1e9, tick)

    loop.call_later(period_ns / 1e9, tick)
    await done.wait()
    return watch.calls()


def main() -> None:
    """Run one measurement."""
    ticks: Ticks = options(Ticks)

    async def measure(parent: Parent) -> None:
        calls = await (by_bus if ticks.way == "bus" else by_call_later)(ticks)
        parent.tell("called", **calls)

    run(measure, by=uvloop.run if ticks.loop == "uvloop" else asyncio.run)


if __name__ == "__main__":
    main()
