"""Publishes a node's log on the topic /rosout.

Owns: the conversion of log entries to messages, and the time of their publication. Must not know: the source
of entries.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any
from weakref import ref

from bus.endpoint.core import EndpointCore
from bus.endpoint.endpoint import core_of
from bus.errors import BusError
from bus.logger import LogEntry, Logger
from bus.publisher import Publisher

__all__ = ["Rosout"]

_END_S = 5.0
"""Time for which the end of a node waits until busd knows its /rosout."""


class Rosout:
    """Publishes entries of `logger` by `publisher`, whose type is rcl_interfaces/msg/Log."""

    def __init__(self, publisher: Publisher[Any], logger: Logger) -> None:
        self._publisher = publisher
        self._core = core_of(publisher)
        self._logger = logger
        self._sink = _weak(self)
        self._declaring: asyncio.Task[None] | None = None
        self._is_open = False

    async def open(self, declare: Callable[[EndpointCore[Any]], Awaitable[None]]) -> None:
        """Declare the publisher before the program's endpoints, without a wait for the answer."""
        link = self._core.link
        self._is_open = True
        self._logger.add_sink(self._sink)  # entries logged before the answer wait for it
        self._declaring = link.loop.create_task(self._declare(declare), name="declare /rosout")
        if link.guarded_loop is None:
            await asyncio.sleep(0)  # after this, the declaration has left
        else:  # such a loop stands still while no call waits, and the log would, too
            await asyncio.wait([self._declaring])

    def close(self) -> None:
        """Stop publishing log entries."""
        self._is_open = False
        self._logger.remove_sink(self._sink)

    async def declared(self) -> None:
        """Wait until logged entries can be handed over, if busd answers soon."""
        declaring, self._declaring = self._declaring, None
        if declaring is not None and not declaring.done():
            try:
                await asyncio.wait([declaring], timeout=_END_S)
            finally:
                declaring.cancel()

    def publish(self, entry: LogEntry) -> None:
        """Publish an entry. Does nothing after the publisher was closed."""
        from bus.msg.builtin_interfaces import Time
        from bus.msg.rcl_interfaces import Log

        if self._core.refusal is not None:
            return
        sec, nanosec = divmod(entry.stamp_ns, 1_000_000_000)
        self._publisher.publish(
            Log(
                stamp=Time(sec=sec, nanosec=nanosec),
                level=int(entry.severity),
                name=entry.name,
                msg=entry.text,
                file=entry.file,
                function=entry.function,
                line=entry.line,
            )
        )

    async def _declare(self, declare: Callable[[EndpointCore[Any]], Awaitable[None]]) -> None:
        try:
            await declare(self._core)
        except (BusError, TimeoutError) as error:
            if self._is_open:  # else the node was closed meanwhile
                self._logger.warning(f"the log of this node stays here: {error}")


def _weak(rosout: Rosout) -> Callable[[LogEntry], None]:
    """A sink that does not keep the node alive: loggers live as long as the process."""
    known = ref(rosout)

    def sink(entry: LogEntry) -> None:
        if (rosout := known()) is not None:
            rosout.publish(entry)

    return sink
