"""Requests of the core to the shell. The shell carries effects out in order."""

from typing import Any, TypeAlias

import msgspec

from bus.base.ids import PeerId
from bus.wire.messages import Message
from bus.wire.runs import RunQueue


class Send(msgspec.Struct, frozen=True):
    """Send a control message to a peer, with the descriptors that it brings (opaque here)."""

    peer: PeerId
    message: Message
    descriptors: tuple[Any, ...] = ()


class Flush(msgspec.Struct, frozen=True):
    """A subscription's queue, which was empty, has samples for its peer.

    The one effect that is not a value: `queue` is the core's own, and the shell takes out of it what the
    socket takes. So nothing is copied, and the core can drop old or excess samples up to the last moment.
    Samples that the shell took no longer count against the peer's quota.
    """

    peer: PeerId
    queue: RunQueue


class Later(msgspec.Struct, frozen=True):
    """There is more to do for a peer, present or gone: call `go_on` in its turns, before handling what it
    sends."""

    peer: PeerId


class Disconnect(msgspec.Struct, frozen=True):
    """Send queued data and cut the connection; the core has forgotten the peer already."""

    peer: PeerId
    reason: str


class Pause(msgspec.Struct, frozen=True):
    """Don't read a peer for so long: it asks for more than it may."""

    peer: PeerId
    pause_ns: int


class Note(msgspec.Struct, frozen=True):
    """Something for the log; `level` is one of logging's numbers."""

    level: int
    text: str


class Stop(msgspec.Struct, frozen=True):
    """End the daemon in order."""

    reason: str


class Restart(msgspec.Struct, frozen=True):
    """End the daemon in order and start it again, if possible; answer `request` of `peer` whether it is."""

    peer: PeerId
    request: int
    reason: str


class Reload(msgspec.Struct, frozen=True):
    """Read the configuration again; answer `request` of `peer` with the changes, or with the fault."""

    peer: PeerId
    request: int


Effect: TypeAlias = Send | Flush | Later | Disconnect | Pause | Note | Stop | Restart | Reload
