"""A busd and two processes, a talker's and a listener's, in one event loop whose time jumps.

def test_it(two: Play) -> None:
    async def story(world: World) -> None:
        talker, listener = nodes(world)
        ...
        world.block(LISTENER)       it reads nothing more from busd
    two(story)
"""

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

import bus
from accounts_world import World
from busd.core.limits import Limits
from jumping_loop import play

TALKER, LISTENER = 1, 2
WINDOW = 16
"""Messages by which a keep-all publisher may be ahead by socket."""

Play = Callable[..., None]


@pytest.fixture
def two(tmp_path: Path, route: str) -> Play:
    """Plays a story with these processes; further arguments are limits of busd, instead of WINDOW."""

    def two(story: Callable[[World], Coroutine[Any, Any, None]], **limits: Any) -> None:
        async def tell() -> None:
            few = limits or {"keep_all_window_messages": WINDOW}
            world = World(tmp_path, [route == "shm"] * 2, Limits(**few))
            await world.open()
            try:
                await story(world)
            finally:
                await world.close()

        play(tell)

    return two


def nodes(world: World) -> tuple[bus.Node, bus.Node]:
    return world.processes[TALKER].node, world.processes[LISTENER].node


async def restart_busd(world: World, *order: int) -> None:
    """Restart busd as kill does it; the processes come back one after the other."""
    for process in world.processes.values():
        process.gate.clear()
    world.stop_busd()
    while any(process.link.connection is not None for process in world.processes.values()):  # noqa: ASYNC110
        await asyncio.sleep(0)
    world.start_busd()
    for number in order:
        world.processes[number].gate.set()
        await world.processes[number].ask()
