"""bus_bridge.dds.turns: calls are made in their order, one for each call that ends."""

import asyncio

import pytest

from bus_bridge.dds import turns as module
from bus_bridge.dds.turns import Turns


class World:
    def __init__(self) -> None:
        self.turns = Turns()
        self.made: list[int] = []

    async def call(self, number: int) -> None:
        await self.turns.wait()
        self.made.append(number)

    async def begin(self, count: int) -> list[asyncio.Task[None]]:
        tasks = [asyncio.create_task(self.call(number)) for number in range(count)]
        await asyncio.sleep(0)
        return tasks


async def test_one_at_a_time_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PAUSE_S", 3600.0)
    world = World()
    tasks = await world.begin(4)
    for number in range(3):
        world.turns.next()
        await tasks[number]
        assert (world.made, len(world.turns)) == ([*range(number + 1)], 3 - number)
    world.turns.end()
    await tasks[3]
    assert world.turns._pause is None
    world.turns.next()  # none waits


async def test_after_a_pause_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PAUSE_S", 0.001)
    world = World()
    await asyncio.gather(*await world.begin(4))
    assert (world.made, world.turns._pause) == ([0, 1, 2, 3], None)


async def test_one_that_is_cancelled_gives_its_turn_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PAUSE_S", 3600.0)
    world = World()
    tasks = await world.begin(3)
    tasks[0].cancel()
    await asyncio.wait(tasks[:1])
    world.turns.next()
    tasks[1].cancel()  # in the turn of the loop in which it was given its own
    await asyncio.wait(tasks)
    assert (world.made, len(world.turns), world.turns._pause) == ([2], 0, None)
