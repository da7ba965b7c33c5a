"""The floor of every broker in Python: two bare hops over UNIX sockets, on uvloop's protocols.

    publisher -> relay -> subscriber, each a process; the relay writes the data that it reads.

It has no framing, no queues, no types and no discovery: all messages have the same size. The text is encoded
and decoded, because the subscriber gets a `str` here, too. Paced only.
"""

import asyncio
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import cast

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run

_FOLDER = Path(os.environ.get("BENCH_FOLDER", "."))
_GREETING = b"!"


def _in() -> str:
    return str(_FOLDER / "in.sock")


def _out() -> str:
    return str(_FOLDER / "out.sock")


class _FromPublisher(asyncio.Protocol):
    def __init__(self, subscribers: list[asyncio.WriteTransport]) -> None:
        self._subscribers = subscribers

    def data_received(self, data: bytes) -> None:
        for transport in self._subscribers:
            transport.write(data)


class _ToSubscriber(asyncio.Protocol):
    def __init__(self, subscribers: list[asyncio.WriteTransport]) -> None:
        self._subscribers = subscribers

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # The classes of uvloop's transports do not derive from asyncio's.
        writer = cast(asyncio.WriteTransport, transport)
        self._subscribers.append(writer)
        writer.write(_GREETING)


class _Subscriber(asyncio.Protocol):
    """Takes the greeting and then texts of `size` bytes."""

    def __init__(self, size: int, take: Callable[[str], None]) -> None:
        self.greeted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._size = size
        self._take = take
        self._rest = b""

    def data_received(self, data: bytes) -> None:
        if not self.greeted.done():
            data = data.removeprefix(_GREETING)
            self.greeted.set_result(None)
        if self._rest:
            data = self._rest + data
        size, end = self._size, len(data) // self._size * self._size
        for offset in range(0, end, size):
            self._take(data[offset : offset + size].decode())
        self._rest = data[end:]


async def relay(parent: Parent) -> None:
    loop = asyncio.get_running_loop()
    subscribers: list[asyncio.WriteTransport] = []
    async with (
        await loop.create_unix_server(lambda: _FromPublisher(subscribers), _in()),
        await loop.create_unix_server(lambda: _ToSubscriber(subscribers), _out()),
    ):
        parent.tell("ready")
        await asyncio.Event().wait()


async def publisher(parent: Parent) -> None:
    transport, _ = await asyncio.get_running_loop().create_unix_connection(asyncio.Protocol, _in())
    send = transport.write
    await roles.publish(parent, options(Work), lambda text: send(text.encode()))


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    taker = roles.Taker(parent, work)
    _, protocol = await asyncio.get_running_loop().create_unix_connection(
        lambda: _Subscriber(work.size, taker.take), _out()
    )
    await protocol.greeted
    parent.tell("ready")
    await taker.finish()


if __name__ == "__main__":
    run({"relay": relay, "publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
