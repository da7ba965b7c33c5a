"""Connections to the server: their costs are bounded, before they are let in and whatever they send."""

import asyncio
from weakref import WeakSet

from websockets.asyncio.server import ServerConnection
from websockets.protocol import State

__all__ = ["Connections"]

_MOST_STRANGERS = 128
"""Any user of the machine may connect, and a process has 1,024 descriptors as a rule."""
_MOST_PONGS = 256 << 10
"""Bytes queued for a client that sends pings and does not read."""


class Connections:
    """All open connections. A connection is a stranger until it is let in.

    The number of strangers is limited: when one more comes, the oldest is cut off. So a client that asks at
    once gets an answer, however many others are silent.
    """

    def __init__(self) -> None:
        self._open: WeakSet[ServerConnection] = WeakSet()
        self._strangers: dict[ServerConnection, None] = {}

    def let_in(self, connection: ServerConnection) -> None:
        """It is no stranger any more."""
        self._strangers.pop(connection, None)

    def cut_off_those_who_ask(self) -> None:
        """Cut off all connections without a WebSocket: the end of a server would wait for them."""
        for connection in self._open:
            if connection.state is State.CONNECTING:
                connection.transport.abort()

    def connection_class(self) -> type[ServerConnection]:
        """The class of connections that report to these `Connections`."""
        these = self

        class Connection(ServerConnection):
            _pongs = 0

            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                these._come(self)

            def connection_lost(self, exc: Exception | None) -> None:
                these.let_in(self)
                super().connection_lost(exc)

            def data_received(self, data: bytes) -> None:
                before = self.transport.get_write_buffer_size()
                super().data_received(
                    data
                )  # which answers pings at once, whether those answers are read or not
                self._pongs = (self._pongs if before else 0) + self.transport.get_write_buffer_size() - before
                if self._pongs > _MOST_PONGS:
                    self.transport.abort()

        return Connection

    def _come(self, connection: ServerConnection) -> None:
        self._open.add(connection)
        self._strangers[connection] = None
        if len(self._strangers) > _MOST_STRANGERS:
            oldest = next(iter(self._strangers))
            del self._strangers[oldest]
            oldest.transport.abort()
