"""One connection of the daemon: from accept over Hello to the end. Makes no routing decision.

Descriptors that a peer sends are looked at here, before the core sees them: nobody shall map what could
shrink under him. Of each peer busd holds one for each publisher, which are limited, its doorbell and its
readers' segment. Those of publishers that are gone may wait for a while to be sent to a peer that does not
read, so there is a bound for all of them together, and new connections always find room.
"""

import asyncio
import os
import resource
import socket
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Protocol

from bus.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.ids import PeerId
from bus.release import RELEASE
from bus.shm.descriptors import doorbell_fault, readers_fault, ring_fault
from bus.transport.stream import Stream
from bus.wire.layout import LEAVING, VERSION
from bus.wire.messages import (
    CreatePublisher,
    Fault,
    Hello,
    Leaving,
    Message,
    ReplaceRing,
    Share,
    encode_frame,
)
from bus.wire.outbox import Outbox
from bus.wire.runs import Account
from bus.wire.session import Carried, Role, Session
from busd.core.limits import Limits
from busd.credentials import Credentials

_FAULTS: dict[type[Message], tuple[Callable[[int], str], ...]] = {
    Share: (doorbell_fault, readers_fault),
    CreatePublisher: (ring_fault,),
    ReplaceRing: (ring_fault,),
}
"""What a message may bring, and how to tell what is wrong with it."""


_SPARE = 32
"""Descriptors for all but connections and what peers share."""


class PeerHost(Protocol):
    """What a connection needs of the server."""

    limits: Limits
    is_background: bool
    began_ns: int
    unknown: Account

    @property
    def capabilities(self) -> tuple[str, ...]: ...

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
            takes_descriptors=True,
        )
        self.stream.session.reader.charge_to(host.unknown)
        self._handshake = asyncio.get_running_loop().call_later(
            host.limits.handshake_s, self.refuse, f"no Hello within {host.limits.handshake_s:g} s"
        )

    def send(self, message: Message) -> None:
        """Queue a control message."""
        self.stream.outbox.put(encode_frame(message))

    def accept(self, carried: Carried) -> tuple[Descriptor, ...]:
        """The descriptors that came with a message; none where busd has too many.

        Raises RemoteProtocolError where one is not what the message says it is.
        """
        kind, claimed = type(carried.message), getattr(carried.message, "descriptors", 0)
        faults = _FAULTS.get(kind, ())
        if claimed != len(faults):
            raise RemoteProtocolError(
                f"{kind.__name__} with {claimed} descriptors, it brings {len(faults)} or none"
            )
        for find_fault, descriptor in zip(faults, carried.descriptors, strict=False):
            if fault := find_fault(descriptor.fileno()):
                raise RemoteProtocolError(f"{kind.__name__} with a bad descriptor: {fault}")
        # Numbers are given lowest first, so a high one says that there are as many.
        room = resource.getrlimit(resource.RLIMIT_NOFILE)[0] - self._host.limits.connections - _SPARE
        return carried.descriptors if all(one.fileno() < room for one in carried.descriptors) else ()

    def charge_to(self, control: Account, unfinished: Account) -> None:
        """Who this is was said: charge what waits for it, and what has not come whole, to these."""
        self.stream.outbox.account = control
        self.stream.session.reader.charge_to(unfinished)

    @property
    def is_choked(self) -> bool:
        """Whether more control frames wait than the peer, or all of its user, may let wait."""
        account = self.stream.outbox.account
        if account is None:
            return False
        return account.is_over or (account.parent is not None and account.parent.is_over)

    def fileno(self) -> int:
        """The number of its socket's descriptor."""
        return self.stream.fileno()

    def let_go(self) -> None:
        """It has hung up before anything of it was read."""
        self._lost(None)
        self.stream.close()

    def pause(self, seconds: float) -> None:
        """Don't listen to the peer for so long."""
        self.stream.pause(seconds)

    def relieve(self) -> None:
        """Send what waits; a peer that does not take it is cut off."""
        self.stream.flush()
        if self.is_choked:
            self._end(
                f"{self.stream.outbox.control_bytes} bytes of control frames wait for it; it does not read"
            )

    def refuse(self, reason: str, *, is_known: bool = False) -> None:
        """Tell the peer why, and cut the connection. `is_known`: it is no news for the log."""
        if not self.stream.is_closed:
            if self.id is None:
                self._greet()  # the first frame is a Hello, also for one that goes again
            self.stream.outbox.put(encode_frame(Fault(text=reason)))
            self._end(reason, is_known=is_known)

    def leave(self, text: str) -> None:
        """busd ends: have the peer end what it sends, and see to it that all that it has sent is heard."""
        hello = self.stream.session.peer
        self.stream.linger()
        if hello is not None and LEAVING in hello.capabilities:
            self.send(Leaving(text=text))
            self.stream.flush()
        else:
            self.stream.hear_out()

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
            capabilities=self._host.capabilities,
            release=RELEASE,
            began_ns=self._host.began_ns,
        )
        self.stream.outbox.put(encode_frame(hello))

    def _lost(self, error: Exception | None) -> None:
        self._handshake.cancel()
        self._host.lose(self, str(error) if error else "closed its connection", is_cut=False)

    def _end(self, reason: str, *, is_known: bool = False) -> None:
        if not self.stream.is_closed:
            self._host.lose(self, reason, is_cut=not is_known)
            self.close()
