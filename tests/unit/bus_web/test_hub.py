"""The bus as all clients of one server see it."""

import asyncio
from collections.abc import AsyncIterator
from unittest.mock import Mock

import pytest

from bus.errors import ConfigurationError, ConnectionClosed
from bus.graph import Graph
from bus.msg.std_msgs import String
from bus_web import hub as module
from bus_web.hub import Watcher
from semantics import until
from web_world import WebWorld


class Seen(Watcher):
    def __init__(self) -> None:
        self.told: list[str] = []

    def looked(self, *, is_new: bool) -> None:
        self.told.append("new" if is_new else "same")

    def lost(self, text: str) -> None:
        self.told.append(text)


async def test_it_looks_only_while_somebody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK_S", "_REST_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, first, second = WebWorld(), Seen(), Seen()
    world.add("publisher", "/talker", "/chatter", String)
    world.look()
    asked = Mock(side_effect=world.node.graph)
    monkeypatch.setattr(world.node, "graph", asked)
    async with world.hub.watching(first):
        await until(lambda: len(first.told) > 1)
        async with world.hub.watching(second):
            await until(lambda: second.told)
        seen = [*second.told]
        await until(lambda: len(first.told) > 4)
        assert second.told == seen, "it watches no more"
    looks = asked.call_count
    assert world.hub._tasks == []
    async with world.hub.watching(second):
        await until(lambda: asked.call_count > looks)
    assert {*first.told} == {"same"}
    await world.close()


async def test_busd_goes_and_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK_S", "_REST_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, seen = WebWorld(), Seen()
    world.look()
    async with world.hub.watching(seen):
        await until(lambda: seen.told)
        with monkeypatch.context() as away:
            away.setattr(world.node, "graph", Mock(side_effect=ConnectionClosed("busd has ended")))
            await until(lambda: world.hub.is_lost)
        await until(lambda: not world.hub.is_lost)
    assert seen.told.count("busd has ended") == 1, "it is said once"
    assert seen.told[-1] == "same"
    await world.close()


async def test_the_end_of_the_connection_is_told_before_an_answer_is_overdue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("_LOOK_S", "_REST_S", "_CONNECTION_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, seen, is_back = WebWorld(), Seen(), asyncio.Event()
    world.look()

    async def graph(*, statistics: bool) -> Graph:
        await is_back.wait()
        assert world.node.now is not None
        return world.node.now

    async with world.hub.watching(seen):
        await until(lambda: seen.told)
        monkeypatch.setattr(world.node, "graph", graph)
        monkeypatch.setattr(world.node, "is_connected", False)
        await until(lambda: world.hub.is_lost)
        assert seen.told[-1] == "its connection has ended, and bus web connects again"
        monkeypatch.setattr(world.node, "is_connected", True)
        is_back.set()
        await until(lambda: not world.hub.is_lost)
    assert seen.told[-1] == "same"
    await world.close()


async def test_a_poll_that_fails_is_reported_once_and_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK_S", "_REST_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, seen, reported = WebWorld(), Seen(), Mock()
    world.look()
    asyncio.get_running_loop().set_exception_handler(reported)
    async with world.hub.watching(seen):
        await until(lambda: seen.told)
        with monkeypatch.context() as broken:
            take = Mock(side_effect=KeyError("gid"))
            broken.setattr(world.hub.model, "take", take)
            await until(lambda: take.call_count > 3)
        await until(lambda: not world.hub.is_lost)
    assert seen.told.count("bus web can't read the graph: KeyError: 'gid'") == 1
    assert seen.told[-1] in {"same", "new"}
    assert reported.call_count == 1
    await world.close()


async def test_busd_refuses_to_tell_of_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK_S", "_REST_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, seen = WebWorld(), Seen()
    world.look()

    async def watch_graph() -> AsyncIterator[Graph]:
        raise ConfigurationError("not now")
        yield Graph()

    monkeypatch.setattr(world.node, "watch_graph", watch_graph)
    async with world.hub.watching(seen):
        await until(lambda: seen.told.count("same") > 2)  # the hub looks all the same
    await world.close()


async def test_types_that_differ_are_described(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_LOOK_S", "_REST_S"):
        monkeypatch.setattr(module, name, 0.001)
    world, seen = WebWorld(), Seen()
    publisher = world.add("publisher", "/talker", "/chatter", String)
    world.add("subscription", "/listener", "/chatter", type_name=publisher.type_name, type_hash="other")
    world.look()
    (before,) = world.hub.model.pairs("/chatter")
    async with world.hub.watching(seen):
        await until(lambda: "new" in seen.told)
    assert before.reason != ""
    assert world.hub._descriptions(publisher.type_name, publisher.type_hash) is not None
    await world.close()
