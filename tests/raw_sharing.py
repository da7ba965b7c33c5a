"""Memory and doorbells that a RawPeer shares, as clients make them, and the messages that carry them."""

import fcntl
import os

from bus.base.descriptor import Descriptor
from bus.wire import messages as m
from raw_peer import RawPeer

FUTURE_WRITE = 0x10  # F_SEAL_FUTURE_WRITE, which Python knows since 3.13
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL | FUTURE_WRITE
SIZE = 128 << 10


def memfd(*, size: int = SIZE, seals: int = SEALS, is_reserved: bool = True) -> Descriptor:
    """A segment; with the default arguments, busd accepts it as a ring or for readers."""
    made = Descriptor(os.memfd_create("busd-test", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
    os.ftruncate(made.fileno(), size)
    if size and is_reserved:
        os.posix_fallocate(made.fileno(), 0, size)
    fcntl.fcntl(made.fileno(), fcntl.F_ADD_SEALS, seals)
    return made


def eventfd() -> Descriptor:
    """A doorbell."""
    return Descriptor(os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK))


def share(peer: RawPeer) -> tuple[Descriptor, Descriptor]:
    """Send Share; returns the doorbell and the readers' segment."""
    doorbell, readers = eventfd(), memfd()
    peer.carry(m.Share(), doorbell, readers)
    return doorbell, readers


def create_publisher(peer: RawPeer, node: int, *descriptors: Descriptor, claims: int = 1) -> int:
    """Request a publisher; returns the number of the request."""
    fields = peer.endpoint_fields(node, "/t", {"descriptors": claims})
    peer.carry(m.CreatePublisher(**fields), *descriptors)
    return int(fields["request"])
