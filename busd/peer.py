"""One connection of the daemon: from accept over Hello to the end. Makes no routing decision."""

import asyncio
import os
import socket
from collections.abc import Iterable
from functools import partial
from typing import Any, Protocol

from bus.errors import RemoteProtocolError
from bus.ids import PeerId
from bus.transport.stream import Stream
from bus.wire.layout import VERSION
from bus.wire.messages import Fault, Hello, Message, encode_frame
from bus.wire.outbox import Outbox
from bus.wire.session import Role, Session
from busd.core.limits import Limits
from busd.credentials import Credentials


class PeerHost(Protocol):
    """What a connection needs of the server."""

    limits: Limits
    is_background: bool

    def greet(self, connection: "PeerConnection", hello: Hello) -> PeerId: ...

    def receive(self, connection: "PeerConnection", items: Iterable[Any]) -> None: ...

    def lose(self, connection: "PeerConnection", reason: str, *, is_cut: bool) -> None: ...


class PeerConnection:
    """`id` is None until the peer has said Hello."""

    def __init__(self, host: PeerHost, sock: socket.socket, credentials: Credentials) -> None:
        self.id: PeerId | None = None
        self.credentials = credentials
        self._host = host
        self.stream = Stream(
            sock,
            Session(Role.BROKER, max_message_bytes=host.limits.message_bytes),
            Outbox(),
            on_received=self._received,
            on_lost=self._lost,
        )
        self._handshake = asyncio.get_running_loop().call_later(
            host.limits.handshake_s, self.refuse, f"no Hello within {host.limits.handshake_s:g} s"
        )

    def send(self, message: Message) -> None:
        """Queue a control message."""
        self.stream.outbox.put(encode_frame(message))

    @property
    def is_choked(self) -> bool:
        """Whether more control frames wait than the peer may let wait."""
        return self.stream.outbox.control_bytes > self._host.limits.control_bytes_per_peer

    def relieve(self) -> None:
        """Send what waits; a peer that does not take it is cut off."""
        self.stream.flush()
        if self.is_choked:
            self._end(
                f"{self.stream.outbox.control_bytes} bytes of control frames wait for it; it does not read"
            )

    def refuse(self, reason: str) -> None:
        """Tell the peer why, and cut the connection."""
        if not self.stream.is_closed:
            if self.id is None:
                self._greet()  # the first frame is a Hello, also for one that goes again
            self.stream.outbox.put(encode_frame(Fault(text=reason)))
            self._end(reason)

    def close(self) -> None:
        """Send what can be sent at once, and close."""
        self._handshake.cancel()
        self.stream.close()

    def _received(self, items: Iterable[Any]) -> None:
        """The first read; later ones go to the host directly."""
        items = iter(items)
        try:
            hello = next(items, None)
        except RemoteProtocolError as error:
            self.refuse(str(error))
            return
        if hello is not None:
            self._handshake.cancel()
            self.id = self._host.greet(self, hello)
            self.stream.on_received = partial(self._host.receive, self)
            self._greet()
            self.stream.flush()
            self._host.receive(self, items)

    def _greet(self) -> None:
        hello = Hello(
            version=VERSION,
            pid=os.getpid(),
            program="busd",
            lease_s=self._host.limits.lease_s,
            background=self._host.is_background,
        )
        self.stream.outbox.put(encode_frame(hello))

    def _lost(self, error: Exception | None) -> None:
        self._handshake.cancel()
        self._host.lose(self, str(error) if error else "closed its connection", is_cut=False)

    def _end(self, reason: str) -> None:
        if not self.stream.is_closed:
            self._host.lose(self, reason, is_cut=True)
            self.close()
