"""`watch_graph`: every change arrives, slow consumers get the newest state, and nothing is left behind."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing
from typing import Any

import pytest

import bus
from conftest import WAIT_S, Daemon
from semantics import Wheel, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


def observers(node: bus.Node) -> list[Any]:
    assert node._link is not None
    return node._link.watch()._observers


def same(one: bus.Graph, other: bus.Graph) -> bool:
    """Whether both are equal, in any order."""
    parts = ("nodes", "publishers", "subscriptions", "matches")
    return one.revision == other.revision and all(
        set(map(repr, getattr(one, part))) == set(map(repr, getattr(other, part))) for part in parts
    )


async def newest(graphs: Any, condition: Callable[[bus.Graph], bool]) -> bus.Graph:
    async for graph in graphs:
        if condition(graph):
            assert isinstance(graph, bus.Graph)
            return graph
    raise AssertionError("it has ended")


async def test_it_follows_what_comes_and_goes(node: bus.Node) -> None:
    async with aclosing(node.watch_graph()) as graphs:
        assert same(await anext(graphs), await node.graph())
        publisher = await node.create_publisher(Wheel, "t", 10)
        async with bus.Node("other", arguments=[]) as other:
            await other.create_subscription(Wheel, "t", 10)
            there = await node.graph()
            seen = await newest(graphs, lambda graph: graph.revision >= there.revision)
            assert same(seen, there)
            assert seen.matches[0].route
        await publisher.close()
        gone = await newest(graphs, lambda graph: not graph.publishers_of("/t") and len(graph.nodes) == 1)
        assert not gone.matches
        assert same(gone, await node.graph())


async def test_it_asks_for_the_graph_once(node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> None:
    link: Any = node._link
    asked: list[object] = []
    request = link.request
    monkeypatch.setattr(link, "request", lambda *what: asked.append(what) or request(*what))
    async with aclosing(node.watch_graph()) as one, aclosing(node.watch_graph()) as other:
        assert await anext(one) == await anext(other)
        for number in range(5):
            await node.create_publisher(Wheel, f"t{number}", 10)
            name = f"/t{number}"
            for graphs in (one, other):
                await newest(graphs, lambda graph, name=name: bool(graph.publishers_of(name)))
    assert len(asked) == 1


async def test_it_asks_a_silent_busd_again(node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> None:
    link: Any = node._link
    request, silences = link.request, iter(range(3))

    async def request_late(*what: Any) -> Any:
        for _ in silences:
            raise TimeoutError("busd says nothing")
        return await request(*what)

    monkeypatch.setattr(link, "request", request_late)
    async with aclosing(node.watch_graph()) as first, aclosing(node.watch_graph()) as second:
        waiting = asyncio.create_task(anext(second))
        assert same(await anext(first), await waiting)
    assert next(silences, None) is None


async def test_who_asks_again_after_a_refusal_is_given_the_graph_though_another_watches_still(
    node: bus.Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    link: Any = node._link
    request, refusals = link.request, iter(range(1))

    async def refused_once(*what: Any) -> Any:
        for _ in refusals:
            raise bus.ConfigurationError("not now")
        return await request(*what)

    monkeypatch.setattr(link, "request", refused_once)
    observers, news = link.watch(), asyncio.Event()
    observers.add(news.set)  # watches still when it has been refused, as a watch may that rests meanwhile
    await news.wait()
    assert str(observers.mirror.failure) == "not now"
    async with aclosing(node.watch_graph()) as again:
        assert same(await anext(again), observers.mirror.graph)
    observers.remove(news.set)


async def test_who_is_slow_gets_the_newest(node: bus.Node) -> None:
    async with aclosing(node.watch_graph()) as graphs:
        await anext(graphs)
        for number in range(20):
            await node.create_publisher(Wheel, f"t{number}", 10)
        now = await node.graph()
        assert same(await anext(graphs), now), "not one for each change that was missed"
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await anext(graphs)


async def test_it_ends_with_the_node(node: bus.Node) -> None:
    async with bus.Node("short", arguments=[]) as short:
        seen: list[bus.Graph] = []

        async def watch() -> str:
            async for graph in short.watch_graph():
                seen.append(graph)
            return "ended"

        watching = asyncio.create_task(watch())
        await until(lambda: seen)
    assert await watching == "ended"
    assert not observers(node)
    with pytest.raises(bus.ConnectionClosed, match="/short is not open"):
        short.watch_graph()


async def test_leaving_the_loop_leaves_nothing_behind(node: bus.Node) -> None:
    async for graph in node.watch_graph():
        assert graph.nodes
        break
    await until(lambda: not observers(node))

    async def watch() -> None:
        async for _ in node.watch_graph():
            pass

    for pause in (0, 0, 0.05):
        watching = asyncio.create_task(watch())
        await asyncio.sleep(pause)
        watching.cancel()
        with pytest.raises(asyncio.CancelledError):
            await watching
        assert not observers(node)
    assert node._link is not None
    await until(lambda: node._link is None or node._link.watch()._asking is None)
    seen = await anext(node.watch_graph())
    assert same(seen, await node.graph())


async def test_over_a_restart_of_busd(daemon: Daemon, node: bus.Node) -> None:
    await node.create_publisher(Wheel, "t", 10)
    async with aclosing(node.watch_graph()) as graphs:
        first = await anext(graphs)
        daemon.kill()
        daemon.restart()
        again = await newest(
            graphs, lambda graph: graph.broker_pid != first.broker_pid and bool(graph.publishers_of("/t"))
        )
        await node.create_publisher(Wheel, "u", 10)
        assert (
            again.revision <= (await newest(graphs, lambda graph: bool(graph.publishers_of("/u")))).revision
        )


async def test_where_the_node_closes_while_busd_is_away(daemon: Daemon) -> None:
    async with asyncio.timeout(WAIT_S), bus.Node("stays", arguments=[]) as stays:
        async with bus.Node("short", arguments=[]) as short:
            await stays.create_publisher(Wheel, "t", 10)
            daemon.kill()
            link: Any = stays._link
            await until(lambda: link.connection is None)
            watching = asyncio.create_task(newest(short.watch_graph(), lambda graph: False))
            await asyncio.sleep(0.02)
        with pytest.raises(AssertionError, match="it has ended"):
            await watching
        daemon.restart()


async def test_a_wait_for_a_graph_ends_with_the_node(node: bus.Node) -> None:
    async with bus.Node("short", arguments=[]) as short:
        waiting = asyncio.create_task(short.wait_for_graph(lambda graph: False))
        await until(lambda: observers(node))
    with pytest.raises(bus.ConnectionClosed, match="/short is closed"):
        await waiting
