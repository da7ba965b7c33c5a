"""One connection of the daemon, from its Hello to the end. Makes no routing decision.

Descriptors that a peer sends are checked here, before the core sees them: no process must map memory that
could shrink under it. For each peer busd holds a descriptor for each publisher (their number is limited), for
its doorbell and for its readers' segment. Rings of publishers that have gone may still wait for a peer that
does not read. So all descriptors together have a bound, and new connections always find room.
"""

import asyncio
import os
import resource
import socket
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol

from bus.base.descriptor import Descriptor
from bus.base.ids import PeerId
from bus.base.version import RELEASE
from bus.errors import RemoteProtocolError
from bus.shm.descriptors import doorbell_fault, readers_fault, ring_fault
from bus.transport.stream import Handlers, Stream
from bus.transport.stream_state import WRITE_OVER, ReadState
from bus.wire.layout import BRIDGES, LEAVING, PROTOCOL_VERSION
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
from busd.core.anteroom import MOST_WAITING
from busd.core.limits import Limits
from busd.core.turns import Party
from busd.server.credentials import Credentials
from busd.server.strangers import strangers

_FAULTS: dict[type[Message], tuple[Callable[[int], str], ...]] = {
    Share: (doorbell_fault, readers_fault),
    CreatePublisher: (ring_fault,),
    ReplaceRing: (ring_fault,),
}
"""The descriptors that a message may bring, and the check of each."""


_SPARE = 32
"""Descriptors for everything except connections and the descriptors of peers."""


_CHOKED_PART = 8
"""If more than this part of the control frames that may wait for a peer do wait, busd stops reading it. Below
half of that it reads on.
"""
_LOOK_S = 1.0
"""How often busd checks whether a peer that it does not read takes data. If not, busd cuts it off: at once if
too much waits for it, otherwise after `_STALL_PART` of the lease.
"""
_STALL_PART = 0.75


class Scheduler(Protocol):
    """The time to serve a connection, and the handling of the data read."""

    def may_read(self, connection: "PeerConnection") -> bool: ...

    def may_write(self, connection: "PeerConnection") -> bool: ...

    def before_write(self, connection: "PeerConnection") -> None: ...

    def receive(self, connection: "PeerConnection", count: int) -> None: ...

    def resume(self, connection: "PeerConnection") -> None: ...


class PeerHost(Protocol):
    """What a connection needs of the server."""

    limits: Limits
    is_background: bool
    began_ns: int

    @property
    def serving(self) -> Scheduler: ...

    def note_alive(self, connection: "PeerConnection") -> None: ...

    def lose(self, connection: "PeerConnection", reason: str, *, is_cut: bool) -> None: ...


def greeting(host: PeerHost) -> bytes:
    """The frame of busd's Hello, which comes first, also on a connection that ends with the next one."""
    return encode_frame(
        Hello(
            version=PROTOCOL_VERSION,
            capabilities=(BRIDGES,),
            pid=os.getpid(),
            program="busd",
            lease_s=host.limits.lease_s,
            background=host.is_background,
            release=RELEASE,
            began_ns=host.began_ns,
        )
    )


class PeerConnection:
    """Takes over `sock`, on which `hello` was read. `id` is the peer's in the core.

    `party` is its process, among the processes that take turns. `control` is charged with the control frames
    that wait for it, `unfinished` with messages that have not come whole.

    While it `is_held`, busd neither reads it nor handles data already read: it has asked too often (`pause`),
    or it does not take the frames sent to it (`put`).
    """

    def __init__(
        self,
        host: PeerHost,
        sock: socket.socket,
        credentials: Credentials,
        hello: Hello,
        id: PeerId,
        party: "Party[Any]",
        control: Account,
        unfinished: Account,
    ) -> None:
        self.id = id
        self.credentials = credentials
        self.party = party
        self.items: Iterator[Any] | None = None
        """Data read but not yet handled."""
        self.is_parked = False
        """Its socket is not read, because it waits for its turn."""
        self.is_early = True  # until the server has looked
        """Entities of its process over an earlier connection are not removed yet; until then it is not read.
        """
        self.is_choked = False
        """It is not read because it does not take what is sent to it."""
        self._host = host
        self._loop = asyncio.get_running_loop()
        self._pause_end: asyncio.TimerHandle | None = None
        self._choke: asyncio.TimerHandle | None = None
        self._choked_bytes = self._choked_looks = 0
        self.stream = Stream(
            sock,
            Session(Role.BROKER, max_message_bytes=host.limits.message_bytes),
            Outbox(control),
            Handlers(
                on_bytes=partial(host.serving.receive, self),
                on_lost=self._lost,
                before_write=partial(host.serving.before_write, self),
                may_read=partial(host.serving.may_read, self),
                may_write=partial(host.serving.may_write, self),
            ),
            strangers,
        )
        self.stream.session.open(hello)
        self.account = control
        self.stream.session.reader.charge_to(unfinished)

    def greet(self) -> None:
        """Answer its Hello."""
        self.stream.outbox.put(greeting(self._host))
        self.stream.flush()

    def put(self, frame: bytes, descriptors: tuple[Descriptor, ...] = ()) -> None:
        """Queue a control frame. If many wait, the peer is not read until it has taken most of them."""
        if self.stream.writing in WRITE_OVER:
            return
        self.stream.outbox.put(frame, descriptors)
        if not self.is_choked and self.account.used > self.account.limit // _CHOKED_PART:
            self.is_choked = True
            self.stream.hold()
            self._choked_bytes, self._choked_looks = self.stream.sent_bytes, 0
            self._choke = self._loop.call_later(_LOOK_S, self._check_choke)

    def accept(self, carried: Carried) -> tuple[Descriptor, ...]:
        """The descriptors that came with a message; none if busd has too many.

        Raises RemoteProtocolError if a descriptor is not of the kind that the message says.
        """
        kind, claimed = type(carried.message), getattr(carried.message, "descriptors", 0)
        faults = _FAULTS.get(kind, ())
        if claimed != len(faults):
            raise RemoteProtocolError(
                f"{kind.__name__} with {claimed} descriptors instead of {len(faults)} or none"
            )
        for find_fault, descriptor in zip(faults, carried.descriptors, strict=False):
            if fault := find_fault(descriptor.fileno()):
                raise RemoteProtocolError(f"{kind.__name__} with a bad descriptor: {fault}")
        # The kernel gives the lowest free number, so a high one shows how many there are.
        room = (
            resource.getrlimit(resource.RLIMIT_NOFILE)[0]
            - self._host.limits.connections
            - MOST_WAITING
            - _SPARE
        )
        return carried.descriptors if all(one.fileno() < room for one in carried.descriptors) else ()

    @property
    def is_held(self) -> bool:
        """Nothing of it is handled now."""
        return self._pause_end is not None or self.is_choked

    @property
    def is_user_over(self) -> bool:
        """More control frames wait for its user's processes than may."""
        whole = self.account.parent
        return whole is not None and whole.used > whole.limit

    def wrote(self) -> None:
        """The socket has taken bytes: perhaps the peer can be read again."""
        if self._choke is None:
            return
        is_drained = self.account.used <= self.account.limit // (2 * _CHOKED_PART)
        if is_drained or self.stream.writing in WRITE_OVER:  # it has gone, and nothing waits for it any more
            self._choke.cancel()
            self._choke, self.is_choked = None, False
            self.stream.release()
            self._host.serving.resume(self)

    def pause(self, seconds: float) -> None:
        """Don't read the peer for so long from now."""
        if self.stream.reading is ReadState.CLOSED:
            return
        if self._pause_end is None:
            self.stream.hold()
        else:
            self._pause_end.cancel()
        self._pause_end = self._loop.call_later(seconds, self.end_pause)

    def end_pause(self) -> None:
        """Read the peer again."""
        if self._pause_end is not None:
            self._pause_end.cancel()
            self._pause_end = None
            self.stream.release()
            self._host.serving.resume(self)

    def relieve(self) -> None:
        """Cut the peer off: it does not take the data queued for it."""
        self._end(f"it does not read: {self.account.used} bytes of control frames are queued for it")

    def refuse(self, reason: str) -> None:
        """Tell the peer why, and cut the connection."""
        if self.stream.reading is not ReadState.CLOSED:
            self.stream.outbox.put(encode_frame(Fault(text=reason)))
            self._end(reason)

    def leave(self, text: str) -> None:
        """busd ends: have the peer stop sending, and read the rest of its data."""
        hello = self.stream.session.peer
        if hello is not None and LEAVING in hello.capabilities:
            self.stream.linger()
            self.put(encode_frame(Leaving(text=text)))
            self.stream.flush()
        else:
            self.stream.drain_input()

    def close(self) -> None:
        """Send as much as the socket takes at once, and close."""
        self._let_go()
        self.stream.close()

    def _let_go(self) -> None:
        self.items = None
        for timer in (self._pause_end, self._choke):
            if timer is not None:
                timer.cancel()

    def _check_choke(self) -> None:
        sent_bytes = self.stream.sent_bytes
        self._choked_looks += 1
        if sent_bytes != self._choked_bytes:
            self._choked_bytes, self._choked_looks = sent_bytes, 0
            self._host.note_alive(self)
        elif self.account.is_over or self._choked_looks * _LOOK_S >= self._host.limits.lease_s * _STALL_PART:
            self.relieve()
            return
        self._choke = self._loop.call_later(_LOOK_S, self._check_choke)

    def _lost(self, error: Exception | None) -> None:
        self._let_go()
        self._host.lose(self, str(error) if error else "closed its connection", is_cut=False)

    def _end(self, reason: str) -> None:
        if self.stream.reading is not ReadState.CLOSED:
            self._host.lose(self, reason, is_cut=True)
            self.close()
