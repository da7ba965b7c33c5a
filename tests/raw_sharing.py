"""Memory and doorbells that a RawPeer shares, as clients make them, and the messages that carry them."""

import fcntl
import mmap
import os
import struct
import time

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


class RawRing:
    """A publisher's ring of the smallest size, whose words a test writes. It has no room for a second lap."""

    OLDEST, LATEST = 128, 256
    _HEADER, _CAPACITY, _INDEX = 640, 4096, 16

    def __init__(self) -> None:
        size = self._HEADER + 8 * self._INDEX + self._CAPACITY
        self.segment = memfd(size=size, seals=0)
        self._memory = mmap.mmap(self.segment.fileno(), size)
        sizes = (size, self._CAPACITY, self._INDEX, self._HEADER, self._HEADER + 8 * self._INDEX)
        self._memory[:64] = struct.pack("<QIIQQQQQQ", 0x676E697264737562, 1, self._HEADER, *sizes, 1)
        self.set(self.OLDEST, 1)
        fcntl.fcntl(self.segment.fileno(), fcntl.F_ADD_SEALS, SEALS)
        self._at = 0

    def set(self, word: int, number: int) -> None:
        self._memory[word : word + 8] = struct.pack("<Q", number)

    def publish(self, seq: int, payload: bytes) -> None:
        """Write a record of at most 32 bytes, and show it."""
        self.set(self._HEADER + 8 * (seq % self._INDEX), self._at)
        head = struct.pack("<QqII8x", seq, time.monotonic_ns(), len(payload), 0)
        begin = self._HEADER + 8 * self._INDEX + self._at
        self._memory[begin : begin + 64] = (head + payload).ljust(64, b"\0")
        self._at += 64
        self.set(self.LATEST, seq)


def ring(doorbell: Descriptor) -> None:
    """Wake the process with this doorbell."""
    os.eventfd_write(doorbell.fileno(), 1)
