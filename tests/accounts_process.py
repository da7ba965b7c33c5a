"""One process of `accounts_world`: a node with its own connection, which a test can hold up and cut."""

import asyncio
from collections.abc import Iterable, Iterator
from typing import Any

import bus
from bus.errors import RemoteProtocolError
from bus.link.link import Link
from bus.link.reach import Patience
from bus.transport.stream import Stream
from bus.transport.stream_state import ReadState
from bus.wire import messages as m


class Process:
    """One node with its own connection; `number` names it in the model."""

    def __init__(self, number: int, node: bus.Node, link: Link) -> None:
        self.number = number
        self.node = node
        self.link = link
        self.gate = asyncio.Event()  # open: it may connect
        self.gate.set()
        self.is_deaf = False
        """Its next connection ends just before the confirmation that its endpoints were made."""
        self.losses = 0
        """How often it has lost its connection and needs another."""
        self._unread: Stream | None = None
        connecting = link._connecting
        connect = connecting.connect

        async def gated(patience: Patience, *, may_start: bool = True) -> Any:
            self.losses += 1
            await self.gate.wait()
            connecting._on_received = self._hear_little if self.is_deaf else self._hear
            if self.is_deaf:
                self.gate.clear()
            return await connect(patience, may_start=False)

        self._hear = link._incoming.received
        connecting.connect = gated  # type: ignore[method-assign]

    @property
    def stream(self) -> Stream | None:
        return None if self.link.connection is None else self.link.connection._stream

    async def ask(self) -> None:
        """Wait for an answer: busd has then read all earlier messages, and its own earlier ones are here."""
        await self.link.request(lambda number: m.Observe(request=number, on=False), m.Done)

    def stop_reading(self) -> None:
        """Stop reading: incoming data, and the end of the connection, wait in the kernel."""
        assert self.stream is not None
        self._unread = self.stream
        asyncio.get_running_loop().remove_reader(self._unread.fileno())

    def go_on_reading(self) -> None:
        unread, self._unread = self._unread, None
        if unread is not None and unread.reading is not ReadState.CLOSED:
            asyncio.get_running_loop().add_reader(unread.fileno(), unread._read)

    def _hear_little(self, items: Iterable[Any]) -> None:
        def until_made() -> Iterator[Any]:
            for item in items:
                if isinstance(item, m.Created) and item.max_message_bytes:
                    raise RemoteProtocolError("a test")
                yield item

        self._hear(until_made())
