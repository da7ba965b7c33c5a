"""Watches of the graph: each gets the newest graph when it is ready for the next one."""

import asyncio
from collections.abc import AsyncGenerator
from time import monotonic
from typing import TYPE_CHECKING

from bus.link.link import Link

if TYPE_CHECKING:  # most programs never watch the graph
    from bus.graph import Graph

_REST, _LONGEST_REST_S = 16, 0.2
"""The pause between two graphs while they change: a multiple of the time to build one, and its limit."""


class GraphWatches:
    """The watches of one node."""

    def __init__(self) -> None:
        self._running: set[asyncio.Event] = set()

    def end(self) -> None:
        """End all watches, because the node is closed."""
        running, self._running = self._running, set()
        for changed in running:
            changed.set()

    async def graphs(self, link: Link) -> "AsyncGenerator[Graph, None]":
        """The present graph, and then one after every change. Raises busd's refusal."""
        changed = asyncio.Event()
        observers = link.watch()
        observers.add(changed.set)
        self._running.add(changed)
        seen = None
        try:
            while changed in self._running:
                changed.clear()
                began_s = monotonic()
                mirror = observers.mirror
                graph = mirror.graph
                rest_s = min(_REST * (monotonic() - began_s), _LONGEST_REST_S)
                if graph is not None and graph is not seen:
                    seen = graph
                    yield graph
                elif (failure := mirror.failure) is not None:
                    raise failure
                await changed.wait()
                await asyncio.sleep(began_s + rest_s - monotonic())
        finally:
            self._running.discard(changed)
            observers.remove(changed.set)
