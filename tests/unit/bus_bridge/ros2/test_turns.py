"""bus_bridge.ros2.turns: calls are made in their order, and few are in the server's queue."""

import asyncio

import pytest

from bus_bridge.ros2 import turns as module
from bus_bridge.ros2.turns import Turns, TurnsOfServices


class World:
    def __init__(self, growth: float = 4.0) -> None:
        self.turns = Turns(growth)
        self.made: list[int] = []

    async def call(self, name: int, client: str) -> int:
        number = await self.turns.begin(client)
        self.made.append(name)
        return number

    async def begin(self, count: int, client: str = "one", first: int = 0) -> list[asyncio.Task[int]]:
        tasks = [asyncio.create_task(self.call(first + number, client)) for number in range(count)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        return tasks


@pytest.fixture
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PAUSE_S", 3600.0)


@pytest.mark.usefixtures("no_pauses")
async def test_eight_at_once_then_one_for_each_that_ends() -> None:
    world = World()
    tasks = [*await world.begin(10, "one"), *await world.begin(10, "other", first=10)]
    assert (world.made, len(world.turns)) == ([*range(8)], 12)
    for number in range(8, 20):
        world.turns.ended(await tasks[number - 8])
        await tasks[number]
        assert (world.made, len(world.turns)) == ([*range(number + 1)], 19 - number)
    assert world.turns._pause is None
    world.turns.ended(await tasks[0])  # once more


@pytest.mark.usefixtures("no_pauses")
async def test_an_answer_tells_that_earlier_requests_are_not_in_the_queue() -> None:
    world = World()
    tasks = await world.begin(20)
    world.turns.answered(await tasks[5])
    await tasks[13]
    assert len(world.made) == 14


async def test_pauses_without_an_answer_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PAUSE_S", 0.001)
    world = World(growth=4e6)
    await (await world.begin(12))[8]
    assert (len(world.made), len(world.turns)) == (9, 3)
    assert world.turns._pause is not None
    assert world.turns._pause.when() > asyncio.get_running_loop().time() + 1000
    world.turns.leave("one")
    same = World(growth=1.0)
    await asyncio.gather(*await same.begin(20))
    assert (same.made, same.turns._pause) == ([*range(20)], None)


@pytest.mark.usefixtures("no_pauses")
async def test_a_cancelled_call_passes_its_turn_on() -> None:
    world = World()
    tasks = await world.begin(11)
    tasks[8].cancel()
    await asyncio.wait(tasks[8:9])
    world.turns.ended(await tasks[0])
    tasks[9].cancel()  # in the turn of the loop in which it was given its own
    await asyncio.wait(tasks)
    assert (world.made, len(world.turns), world.turns._pause) == ([*range(8), 10], 0, None)


@pytest.mark.usefixtures("no_pauses")
async def test_a_client_that_leaves_waits_no_longer() -> None:
    world = World()
    (*_, first) = await world.begin(10, "one")
    (last,) = await world.begin(1, "other", first=10)
    world.turns.leave("one")
    await first
    assert (len(world.turns), last.done()) == (1, False)
    last.cancel()


async def test_clients_of_a_service_share_their_turns() -> None:
    all_turns = TurnsOfServices()
    first = all_turns.find("/ask", is_of_results=False)
    assert all_turns.find("/ask", is_of_results=False) is first
    assert all_turns.find("/other", is_of_results=False) is not first


async def test_turns_of_results_do_not_slow_down() -> None:
    """A server answers requests for results when their goals end."""
    all_turns = TurnsOfServices()
    results, others = (all_turns.find(str(one), is_of_results=one) for one in (True, False))
    assert (results._growth, others._growth) == (1.0, 4.0)
