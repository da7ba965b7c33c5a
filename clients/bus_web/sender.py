"""Sends frames from an outbox to a WebSocket, as fast as the client reads."""

import asyncio
from typing import Protocol

from bus_web.outbox import Outbox

__all__ = ["Sender", "Socket"]

_MOST_NOTICES, _MOST_NOTICE_BYTES = 64, 1 << 20


class Socket(Protocol):
    """A WebSocket, as far as it is used here."""

    async def send(self, message: bytes, *, text: bool) -> None: ...

    async def recv(self) -> str | bytes: ...


class Sender:
    """Frames wait in an `outbox` until `run` has sent them.

    A frame that begins with a brace is JSON, and is sent as text. No binary frame of ours begins with a
    brace.
    """

    def __init__(self, socket: Socket, outbox: Outbox) -> None:
        self._socket = socket
        self._outbox = outbox
        self._is_filled = asyncio.Event()
        self._is_drained = asyncio.Event()
        self._is_drained.set()

    @property
    def notices(self) -> int:
        """Number of queued frames without a topic. They are never dropped: look before adding more."""
        return self._outbox.notices

    @property
    def notice_bytes(self) -> int:
        """Bytes of these frames."""
        return self._outbox.notice_bytes

    @property
    def is_behind(self) -> bool:
        """Whether so many wait that nothing more should be done for this client."""
        return self.notices >= _MOST_NOTICES or self.notice_bytes >= _MOST_NOTICE_BYTES

    def notify(self, frame: bytes) -> None:
        """Queue a frame without a topic."""
        self._outbox.notify(frame)
        self._is_drained.clear()
        self._is_filled.set()

    def put(self, topic: str, frame: bytes) -> None:
        """Queue a message of a topic; older ones are dropped if there is no room."""
        self._outbox.put(topic, frame)
        self._is_filled.set()

    def forget(self, topic: str) -> None:
        """Its messages need not be sent any more."""
        self._outbox.forget(topic)

    def close(self) -> None:
        """The client has gone."""
        self._outbox.close()

    def take_dropped(self) -> dict[str, int]:
        """How many messages of each topic were dropped since this was asked last."""
        dropped = dict(self._outbox.dropped)
        self._outbox.dropped.clear()
        return dropped

    async def drain(self) -> None:
        """Wait until all frames without a topic have been sent."""
        await self._is_drained.wait()

    async def run(self) -> None:
        """Send until cancelled. Raises the socket's exception when it ends."""
        while True:
            frame = self._outbox.take()
            if frame is None:
                self._is_filled.clear()
                await self._is_filled.wait()
                continue
            await self._socket.send(frame, text=frame.startswith(b"{"))
            if not self._outbox.notices:
                self._is_drained.set()
