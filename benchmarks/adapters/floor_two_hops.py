"""The floor of every broker in Python: two bare hops over UNIX sockets, on uvloop's protocols.

    publisher -> relay -> subscriber, each a process; the relay writes on what it reads.

No framing, no queues, no types, no discovery: messages have one size, and the text is encoded and decoded,
because it ends as a `str` in the subscriber's hands here too. Only paced.
"""

import asyncio
import os
import sys
from pathlib import Path
from time import monotonic_ns
from typing import cast

import msgspec

from benchmarks.work import Work, arrivals, pace
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
        # uvloop's transports are not asyncio's by class.
        writer = cast(asyncio.WriteTransport, transport)
        self._subscribers.append(writer)
        writer.write(_GREETING)


class _Subscriber(asyncio.Protocol):
    """Takes the greeting and then `total` texts of `size` bytes."""

    def __init__(self, size: int, total: int) -> None:
        loop = asyncio.get_running_loop()
        self.greeted: asyncio.Future[None] = loop.create_future()
        self.complete: asyncio.Future[None] = loop.create_future()
        self.arrived_ns: list[int] = []
        self.texts: list[str] = []
        self._size = size
        self._total = total
        self._rest = b""

    def data_received(self, data: bytes) -> None:
        if not self.greeted.done():
            data = data.removeprefix(_GREETING)
            self.greeted.set_result(None)
        if self._rest:
            data = self._rest + data
        size, end = self._size, len(data) // self._size * self._size
        for offset in range(0, end, size):
            text = data[offset : offset + size].decode()
            self.arrived_ns.append(monotonic_ns())
            self.texts.append(text)
        self._rest = data[end:]
        if len(self.texts) == self._total:
            self.complete.set_result(None)


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
    work: Work = options(Work)
    transport, _ = await asyncio.get_running_loop().create_unix_connection(asyncio.Protocol, _in())
    parent.tell("ready")
    await parent.wait_for("go")
    await pace(lambda text: transport.write(text.encode()), work)
    await asyncio.Event().wait()


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    _, protocol = await asyncio.get_running_loop().create_unix_connection(
        lambda: _Subscriber(work.size, work.warm_up + work.count), _out()
    )
    await protocol.greeted
    parent.tell("ready")
    await protocol.complete
    found = arrivals(protocol.texts, protocol.arrived_ns, work)
    parent.tell("received", **msgspec.to_builtins(found))
    await asyncio.Event().wait()


if __name__ == "__main__":
    run({"relay": relay, "publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
