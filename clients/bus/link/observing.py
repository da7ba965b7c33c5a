"""Keeps a copy of the graph up to date while a program of this process watches it."""

import asyncio
from collections.abc import Callable
from typing import Protocol, TypeVar

from bus.errors import BusError
from bus.link.connection import Connection
from bus.link.graph_mirror import GraphMirror
from bus.wire import messages as m

__all__ = ["GraphObservers"]

A = TypeVar("A", bound=m.Message)


class _Link(Protocol):
    """The link over which the graph comes."""

    loop: asyncio.AbstractEventLoop
    connection: Connection | None

    async def request(self, make: Callable[[int], m.Message], kind: type[A]) -> A: ...


class GraphObservers:
    """Calls all observers when `mirror` has changed.

    The broker sends changes only while there are observers.
    """

    def __init__(self, link: _Link) -> None:
        self.mirror = GraphMirror()
        """The copy of the graph, begun with the first observer."""
        self._link = link
        self._observers: list[Callable[[], None]] = []
        self._asking: asyncio.Task[None] | None = None

    def __bool__(self) -> bool:
        return bool(self._observers)

    def add(self, notify: Callable[[], None]) -> None:
        """Call `notify` after each change, until `remove`."""
        self._observers.append(notify)
        if len(self._observers) == 1 or self.mirror.failure is not None:  # a new observer starts a retry
            self.ask()

    def remove(self, notify: Callable[[], None]) -> None:
        self._observers.remove(notify)
        if not self._observers:
            self.stop()
            if self._link.connection is not None:
                self._link.connection.send(m.Observe(request=0, on=False))

    def ask(self) -> None:
        """Begin a new copy: request the graph of the present broker."""
        self.stop()
        self.mirror = GraphMirror()
        self._asking = self._link.loop.create_task(self._ask(self.mirror), name="watch the graph")

    def stop(self) -> None:
        """Stop waiting for a graph."""
        if self._asking is not None:
            self._asking.cancel()
            self._asking = None

    def change(self, change: m.GraphChanged) -> None:
        """Apply a change reported by the broker."""
        if self._observers:  # else it was already on its way
            self.mirror.change(change)
            self._notify()

    async def _ask(self, mirror: GraphMirror) -> None:
        """Request the graph until busd answers; the log reports a silent busd."""
        while mirror.graph is None and mirror.failure is None:
            try:
                snapshot = await self._link.request(lambda number: m.Observe(request=number), m.GraphSnapshot)
                mirror.begin(snapshot)
            except TimeoutError:
                continue
            except BusError as error:
                mirror.failure = error
        self._notify()

    def _notify(self) -> None:
        for notify in tuple(self._observers):
            notify()
