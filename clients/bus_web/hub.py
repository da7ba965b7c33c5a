"""The bus as all pages of one server see it: one node, one look a second, as long as a viewer is there."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager, suppress
from time import monotonic_ns

from bus.errors import BusError
from bus.node import Node
from bus_web.descriptions import Descriptions
from bus_web.model import Model
from bus_web.outbox import SharedBudget
from bus_web.shared_subscriptions import SharedSubscriptions

__all__ = ["Hub", "Watcher"]

_LOOK_S = 1.0
_REST_S = 0.2
"""Rest between looks at a graph that changes all the time."""
_ANSWER_S = 2.0
"""busd answers in milliseconds: after so long it is away."""
_CONNECTION_S = 0.2
"""Period of the checks of the connection: a busd that has ended is reported before its answer is overdue."""


class Watcher:
    """Is notified of looks. Its methods must not raise."""

    def looked(self, *, is_new: bool) -> None:
        """The model has a new look; `is_new`: with other nodes, endpoints or matches."""

    def lost(self, text: str) -> None:
        """busd does not answer. Once it does, there is a look."""


class Hub:
    """Looks at the bus for its watchers, and at topics for listeners (`subscriptions`).

    Without a watcher it asks busd nothing, and is told nothing.
    """

    def __init__(self, node: Node, pid: int) -> None:
        self.node = node
        self.subscriptions = SharedSubscriptions(node)
        self._descriptions = Descriptions(node)
        self.model = Model(own=[pid], describe=self._descriptions)
        self.is_lost = False
        self.waiting = SharedBudget()
        """The frames queued for all clients."""
        self._watchers: dict[Watcher, None] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._changed = asyncio.Event()

    @property
    def has_looked(self) -> bool:
        """Whether the model has something to show."""
        return self.model.has_graph

    @asynccontextmanager
    async def watching(self, watcher: Watcher) -> AsyncIterator[None]:
        """Inside the context, the hub notifies the watcher."""
        self._watchers[watcher] = None
        if len(self._watchers) == 1:
            self._changed.set()
            loop = asyncio.get_running_loop()
            works = (self._poll_graph(), self._watch(), self._watch_connection())
            self._tasks = [loop.create_task(work) for work in works]
        try:
            yield
        finally:
            self._watchers.pop(watcher, None)
            if not self._watchers:
                tasks, self._tasks = self._tasks, []
                for task in tasks:
                    task.cancel()
                for ended in await asyncio.gather(*tasks, return_exceptions=True):
                    if isinstance(ended, Exception):
                        raise ended

    async def aclose(self) -> None:
        """End all subscriptions. The node stays."""
        await self.subscriptions.close()

    async def _watch(self) -> None:
        """Have changes of the graph seen at once; if busd refuses that, with the next look."""
        with suppress(BusError):
            async with aclosing(self.node.watch_graph()) as graphs:
                async for _ in graphs:
                    self._changed.set()

    async def _watch_connection(self) -> None:
        while True:
            if not self.node.is_connected:
                self._lose("its connection has ended, and bus web connects again")
            await asyncio.sleep(_CONNECTION_S)

    async def _poll_graph(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._changed.clear()
            began_s = loop.time()
            try:
                await self._poll()
            except (BusError, TimeoutError) as error:
                self._lose(str(error) or "busd does not answer")
            except Exception as error:  # the polls must not end in silence: no page would show a topic
                if not self.is_lost:
                    loop.call_exception_handler({"message": "a poll of the graph failed", "exception": error})
                self._lose(f"bus web can't read the graph: {type(error).__name__}: {error}")
            await asyncio.sleep(_REST_S)
            with suppress(TimeoutError):
                async with asyncio.timeout_at(began_s + _LOOK_S):
                    await self._changed.wait()

    async def _poll(self) -> None:
        async with asyncio.timeout(_ANSWER_S):
            graph = await self.node.graph(statistics=True)
        is_new = self.model.take(graph, monotonic_ns())
        if is_new:
            self.subscriptions.follow(graph)
        self.is_lost = False
        self._show(is_new=is_new)
        if await self._descriptions.ask():
            self.model.forget_pairs()
            self._show(is_new=True)

    def _lose(self, text: str) -> None:
        if not self.is_lost:
            self.is_lost = True
            for watcher in [*self._watchers]:
                watcher.lost(text)

    def _show(self, *, is_new: bool) -> None:
        for watcher in [*self._watchers]:
            watcher.looked(is_new=is_new)
