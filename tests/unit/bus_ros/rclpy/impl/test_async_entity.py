"""The life of an endpoint of an AsyncNode: each cell of its table, without a bus."""

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from bus.errors import BusError
from bus.node import Node as NativeNode
from bus_ros.rclpy.impl.async_entity import TRANSITIONS, AsyncEntity, EntityEvent, EntityState
from bus_ros.rclpy.impl.openings import Openings
from rows import for_each
from transitions import paths

PATHS = paths(TRANSITIONS, EntityState.MADE)
CELLS = [(state, event) for state in EntityState for event in EntityEvent]


class Owner:
    """A node that notes the work given to it."""

    node: Any = None
    native: Any = None

    def __init__(self) -> None:
        self.forgotten: list[AsyncEntity] = []
        self.behind = 0

    def forget(self, entity: AsyncEntity) -> None:
        self.forgotten.append(entity)

    def run_behind(self, work: Coroutine[Any, Any, Any]) -> None:
        self.behind += 1
        work.close()


class Entity(AsyncEntity):
    """An endpoint that notes its calls; `answer` is busd's."""

    def __init__(self, owner: Any) -> None:
        super().__init__(owner)
        self.calls: list[str] = []
        self.answer: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def _open(self, native_node: NativeNode) -> None:
        await self.answer

    def _became_open(self) -> None:
        self.calls.append("open")

    def _stop(self) -> None:
        self.calls.append("stop")

    async def _close(self) -> None:
        """Nothing to close."""


def test_every_state_can_be_reached() -> None:
    assert set(PATHS) == set(EntityState)


@for_each("cell", CELLS)
def test_each_cell(cell: tuple[EntityState, EntityEvent]) -> None:
    state, event = cell
    node: Any = Owner()
    entity = AsyncEntity(node)
    for earlier in PATHS[state]:
        entity._change(earlier)
    assert entity.state is state
    following = TRANSITIONS[state].get(event)
    if following is None:
        with pytest.raises(KeyError):
            entity._change(event)
    else:
        assert entity._change(event) is following is entity.state
    assert entity.is_destroyed is (entity.state is EntityState.DESTROYED)


async def opening(owner: Owner) -> tuple[Entity, "asyncio.Task[None]"]:
    entity = Entity(owner)
    entity.begin(Openings.of(asyncio.get_running_loop()))
    task = asyncio.create_task(entity.open())
    await asyncio.sleep(0)
    return entity, task


async def test_opened_and_destroyed() -> None:
    owner = Owner()
    entity, task = await opening(owner)
    entity.answer.set_result(None)
    await task
    entity.destroy()
    entity.destroy()
    assert entity.calls == ["open", "stop"]
    assert owner.forgotten == [entity] and owner.behind == 1


async def test_destroyed_while_busd_is_asked() -> None:
    owner = Owner()
    entity, task = await opening(owner)
    entity.destroy()
    assert entity.calls == ["stop"] and owner.behind == 0
    entity.answer.set_result(None)
    await task
    assert entity.calls == ["stop"] and owner.behind == 1, "the native endpoint is closed"


async def test_destroyed_while_busd_is_asked_and_refuses() -> None:
    entity, task = await opening(Owner())
    entity.destroy()
    entity.answer.set_exception(BusError("the node is closed"))
    await task


async def test_refused() -> None:
    owner = Owner()
    entity, task = await opening(owner)
    entity.answer.set_exception(BusError("no"))
    with pytest.raises(BusError, match="no"):
        await task
    assert entity.is_destroyed and owner.forgotten == [entity] and owner.behind == 0


async def test_destroyed_before_its_node_runs() -> None:
    owner = Owner()
    entity = Entity(owner)
    entity.destroy()
    entity.begin(Openings.of(asyncio.get_running_loop()))
    await entity.open()
    assert entity.calls == ["stop"] and owner.behind == 0


class Publisher:
    """A publisher that notes whether it holds its messages."""

    holds = 0

    def hold(self) -> None:
        self.holds += 1

    def release(self) -> None:
        self.holds -= 1


class Listening(Entity):
    """A subscription to /chatter."""

    def _read_topic(self) -> str:
        return "/chatter"


@pytest.mark.parametrize("end", ["opened", "refused", "destroyed", "cancelled before it began"])
async def test_publishers_wait_until_its_opening_is_over(end: str) -> None:
    openings, publisher = Openings.of(asyncio.get_running_loop()), Publisher()
    openings.add_publisher("/chatter", publisher)
    entity = Listening(Owner())
    entity.begin(openings)
    task = asyncio.create_task(entity.open())
    if end != "cancelled before it began":
        await asyncio.sleep(0)
    assert publisher.holds == 1
    if end == "opened":
        entity.answer.set_result(None)
    elif end == "refused":
        entity.answer.set_exception(BusError("no"))
    elif end == "destroyed":
        entity.destroy()
        assert publisher.holds == 0, "at once"
        entity.answer.set_result(None)
    else:
        task.cancel()
    await asyncio.wait([task])
    entity.destroy()
    assert publisher.holds == 0


async def test_publishers_do_not_wait_for_what_is_destroyed() -> None:
    openings, publisher = Openings.of(asyncio.get_running_loop()), Publisher()
    openings.add_publisher("/chatter", publisher)
    entity = Listening(Owner())
    entity.destroy()
    entity.begin(openings)
    assert publisher.holds == 0
