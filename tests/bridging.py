"""Buses joined by bridges in one process, over engines without a network: see `world/engine_pair.py`."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import bus
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.bridge import Bridge, BridgeOptions
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from conftest import Daemon
from engine_pair import Network, PairEngine
from forks import Forks

__all__ = ["Site", "World", "world"]


class Site:
    """One bus: its busd, and the bridges that run there."""

    def __init__(self, name: str, daemon: Daemon, stack: AsyncExitStack) -> None:
        self.name = name
        self.daemon = daemon
        self.socket = daemon.path
        self._stack = stack

    async def node(self, name: str, **more: Any) -> bus.Node:
        return await self._stack.enter_async_context(
            bus.Node(name, arguments=[], socket=self.socket, rosout=False, **more)
        )


class Running:
    """A bridge that runs."""

    def __init__(self, site: Site, engine: Any, **options: Any) -> None:
        self.site = site
        self.engine = engine
        self.bridge: Bridge
        self.node: bus.Node
        self._options = options
        self._task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        rules: dict[str, Any] = {name: self._options.get(name, ()) for name in ("allow", "deny", "topics")}
        options = BridgeOptions(
            bus=self.site.name,
            rules=Rules(**rules),
            naming=Naming(self._options.get("namespace", "")),
            bounds=self._options.get("bounds", Bounds()),
            socket=self.site.socket,
        )
        opened = asyncio.Event()

        async def run() -> None:
            self.node = bus.Node(
                "bridge_pair",
                arguments=[],
                socket=self.site.socket,
                origin=bus.Origin("pair", self.site.name),
            )
            async with self.node:
                self.bridge = Bridge(self.node, self.engine, options)
                opened.set()
                await self.bridge.run()

        self._task = asyncio.create_task(run())
        opening = asyncio.create_task(opened.wait())
        await asyncio.wait((self._task, opening), return_when=asyncio.FIRST_COMPLETED)
        opening.cancel()
        if self._task.done():
            self._task.result()

    async def stop(self) -> None:
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def restart(self) -> None:
        await self.stop()
        await self.start()


class World:
    """Makes buses and bridges; what is still there at the end is ended."""

    def __init__(self, start: Callable[[str], Daemon], stack: AsyncExitStack) -> None:
        self._start = start
        self._stack = stack
        self.network = Network()

    def site(self, name: str) -> Site:
        return Site(name, self._start(name), self._stack)

    async def bridge(self, site: Site, **options: Any) -> Running:
        """A bridge on `site`, not linked yet."""
        running = Running(site, PairEngine(site.name), **options)
        self._stack.push_async_callback(running.stop)
        await running.start()
        return running

    async def pair(self, **options: Any) -> tuple[Site, Site, Running, Running]:
        """Two buses, `left` and `right`, whose bridges are linked."""
        left, right = self.site("left"), self.site("right")
        one, other = await self.bridge(left, **options), await self.bridge(right, **options)
        self.network.join(one.engine, other.engine)
        return left, right, one, other


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forks: Forks) -> Iterator[Callable[[], Any]]:
    """`async with world() as made:` gives a World."""
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    daemons: list[Daemon] = []

    def start(name: str) -> Daemon:
        daemons.append(Daemon(tmp_path / f"busd-{name}.sock", forks=forks))
        return daemons[-1]

    @asynccontextmanager
    async def made() -> AsyncIterator[World]:
        async with AsyncExitStack() as stack:
            yield World(start, stack)

    yield made
    for daemon in daemons:
        log = daemon.stop()
        assert "Traceback" not in log, log
