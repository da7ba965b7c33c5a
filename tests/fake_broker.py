"""A broker with scripted messages, to test the reactions of a client.

    async with FakeBroker(path) as broker:
        opening = asyncio.ensure_future(node.open())
        client = await broker.accept()          a connection, after the exchange of Hellos
        request = await client.expect(m.CreateNode)
        client.send(m.Created(request=request.request, id=1))

It runs in the test's event loop, so a test controls the order of events.
"""

import asyncio
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.session import Carried, Role, Session

T = TypeVar("T")


class FakeBroker:
    """Listens at `path` while it is entered."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._accepted: asyncio.Queue[FakeConnection] = asyncio.Queue()
        self._connections: list[FakeConnection] = []

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_unix_server(self._on_connected, self._path)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        for connection in self._connections:
            await connection.close()
        self._path.unlink(missing_ok=True)

    @property
    def connections(self) -> int:
        """The number of connections so far."""
        return len(self._connections)

    async def meet(self) -> "FakeConnection":
        """The next connection, before any message."""
        return await self._accepted.get()

    async def accept(self, *, lease_s: float = 1e6) -> "FakeConnection":
        """The next connection, after the exchange of Hellos; no sign of life comes in between."""
        connection = await self.meet()
        await connection.expect(m.Hello)
        connection.send(m.Hello(version=PROTOCOL_VERSION, pid=os.getpid(), program="fake", lease_s=lease_s))
        return connection

    async def _on_connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = FakeConnection(reader, writer)
        self._connections.append(connection)
        self._accepted.put_nowait(connection)


class FakeConnection:
    """One client."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer
        self._session = Session(Role.BROKER)
        self._waiting: list[Any] = []

    def write(self, raw: bytes) -> None:
        self._writer.write(raw)

    def send(self, *messages: m.Message) -> None:
        self.write(b"".join(map(m.encode_frame, messages)))

    async def receive(self) -> Any:
        """The next message or run; None at the end."""
        while not self._waiting:
            buffer = self._session.reader.get_buffer()
            raw = await self._reader.read(len(buffer))
            if not raw:
                return None
            buffer[: len(raw)] = raw
            self._waiting.extend(self._session.received(len(raw)))
        item = self._waiting.pop(0)
        return item.message if isinstance(item, Carried) else item  # descriptors are ignored

    async def expect(self, kind: type[T]) -> T:
        """The next message of that kind; earlier ones are skipped."""
        while (item := await self.receive()) is not None:
            if isinstance(item, kind):
                return item
        raise AssertionError(f"the client closed the connection; no {kind.__name__} came")

    async def create(
        self, kind: type[m.CreateNode | m.CreatePublisher | m.CreateSubscription], id: int
    ) -> Any:
        """Answer the next request of that kind with that id; returns the request."""
        request = await self.expect(kind)
        self.send(m.Created(request=request.request, id=id, depth=10, max_message_bytes=1 << 20))
        return request

    async def close(self) -> None:
        self._writer.close()
        try:
            await self._writer.wait_closed()
        except ConnectionError:
            pass
