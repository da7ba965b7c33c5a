"""Buses joined by bridges in one process, over engines without a network: see `world/engine_pair.py`."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.msg.std_msgs import Int32
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.bridge import Bridge, BridgeOptions
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from conftest import WAIT_S, Daemon
from engine_pair import Network, PairEngine, Switch
from forks import Forks
from semantics import until

__all__ = ["KEPT", "LATCHED", "LOSSLESS", "Made", "Running", "Site", "Talk", "World", "received", "world"]

LATCHED = bus.QoSProfile(1, durability="transient_local")
KEPT = bus.QoSProfile(10, durability="transient_local")
LOSSLESS = bus.QoSProfile(history="keep_all")


async def received(subscription: bus.Subscription[Any], number: int) -> list[Any]:
    """The `data` of the next `number` messages."""
    return [(await subscription.receive())[0].data for _ in range(number)]


class Site:
    """One bus: its busd, and its bridges."""

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
    """A running bridge."""

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
            rules=(chosen := Rules(**rules)),
            naming=Naming(self._options.get("namespace", ""), chosen.far_names),
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


class Talk:
    """Two linked buses: once `is_on`, messages of `publisher` (left) reach `subscription` (right)."""

    def __init__(
        self,
        sides: tuple[Site, Site, Running, Running],
        link: Switch,
        publisher: bus.Publisher[Any],
        subscription: bus.Subscription[Any],
    ) -> None:
        self.left, self.right, self.one, self.other = sides
        self.link = link
        self.publisher = publisher
        self.subscription = subscription

    async def is_on(self) -> None:
        """Wait until each end knows the other."""
        await self.publisher.wait_for_subscriptions()
        await self.subscription.wait_for_publishers()

    async def cut(self) -> None:
        """Cut the link, and wait until each end knows."""
        self.link.down()
        await until(lambda: self.publisher.get_subscription_count() == 0)
        await until(lambda: self.subscription.get_publisher_count() == 0)

    async def exchange(self) -> None:
        """Publish numbers until they arrive, and check that each arrives once."""
        await self.is_on()
        said = 0
        heard: list[int] = []
        async with asyncio.timeout(WAIT_S):
            while not heard or heard[-1] != said:
                if not heard:  # earlier numbers may be lost without a match
                    said += 1
                    self.publisher.publish(Int32(data=said))
                with suppress(TimeoutError):
                    async with asyncio.timeout(0.2):
                        heard += await received(self.subscription, 1)
        assert heard == list(range(heard[0], said + 1))
        assert self.subscription.take() is None


class World:
    """Makes buses and bridges; at the end, it ends the remaining ones."""

    def __init__(self, start: Callable[[str], Daemon], stack: AsyncExitStack) -> None:
        self._start = start
        self._stack = stack
        self.network = Network()

    def site(self, name: str) -> Site:
        return Site(name, self._start(name), self._stack)

    async def bridge(self, site: Site, **options: Any) -> Running:
        """Start a bridge on `site`, not linked yet."""
        running = Running(site, PairEngine(site.name), **options)
        self._stack.push_async_callback(running.stop)
        await running.start()
        return running

    async def pair(self, **options: Any) -> tuple[Site, Site, Running, Running]:
        """Make two buses, `left` and `right`, with linked bridges."""
        left, right = self.site("left"), self.site("right")
        one, other = await self.bridge(left, **options), await self.bridge(right, **options)
        self.network.join(one.engine, other.engine)
        return left, right, one, other

    async def talk(
        self, qos: bus.QoSProfile | int = 10, *, heard: bus.QoSProfile | int | None = None, kind: Any = Int32
    ) -> Talk:
        """Make a pair: nodes `talker` and `listener` on the topic `numbers`. `heard`: the listener's QoS."""
        left, right, one, other = await self.pair()
        publisher = await (await left.node("talker")).create_publisher(kind, "numbers", qos)
        listener = await right.node("listener")
        subscription = await listener.create_subscription(kind, "numbers", qos if heard is None else heard)
        return Talk((left, right, one, other), self.network.links[-1], publisher, subscription)


Made = Callable[[], AbstractAsyncContextManager[World]]
"""The type of the fixture `world`."""


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forks: Forks) -> Iterator[Made]:
    """`async with world() as made:` makes a World."""
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
