"""Makes and maps segments, and makes doorbells. docs/ring.md describes their contents.

Owns the rules that keep segments from leaking and from harming other processes. A segment has no name, its
memory is reserved when it is made, and it is sealed before another process sees it. Must not know the
receivers of a segment. Functions that need the native core raise ImportError without it.
"""

import fcntl
import os
from collections.abc import Callable

from bus import shm
from bus.base.descriptor import Descriptor
from bus.shm.descriptors import SEALS, readers_fault, ring_fault
from bus.shm.headroom import claim
from bus.shm.openfiles import set_aside

__all__ = [
    "RING_HEAD_BYTES",
    "identity",
    "make_doorbell",
    "make_readers",
    "make_ring",
    "map_readers",
    "map_ring",
]

_STEP_BYTES = 4 << 20

RING_HEAD_BYTES = 32
"""Bytes of a record before its payload. A payload has at most a quarter of the ring's bytes, less this."""


def make_ring(capacity: int, index_length: int, first_seq: int) -> "tuple[Descriptor, shm.native.Mapping]":
    """Make an empty ring of `capacity` bytes for payloads and `index_length` records, both powers of two.

    Raises ValueError for sizes out of bounds, OSError if memory or descriptors are lacking.
    """
    size = shm.native.ring_bytes(capacity, index_length)
    return _make("busd-ring", size, lambda memory: memory.format_ring(capacity, index_length, first_seq))


def make_readers(slot_count: int) -> "tuple[Descriptor, shm.native.Mapping]":
    """Make a readers' segment with free slots. Raises as `make_ring`."""
    size = shm.native.readers_bytes(slot_count)
    return _make("busd-readers", size, lambda memory: memory.format_readers(slot_count))


def map_ring(descriptor: Descriptor) -> "shm.native.Mapping":
    """Map another process's ring, read-only. Raises ValueError with the fault of the ring, or OSError."""
    return _map(descriptor, ring_fault)


def map_readers(descriptor: Descriptor) -> "shm.native.Mapping":
    """Map another process's readers' segment, read-only. Raises as `map_ring`."""
    return _map(descriptor, readers_fault)


def make_doorbell() -> Descriptor:
    """Make a doorbell: an eventfd that never blocks. Raises OSError."""
    return Descriptor(os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK))


def identity(descriptor: Descriptor) -> tuple[int, int]:
    """The segment's identity, the same for all its descriptors. Unique while any process maps the segment."""
    status = os.fstat(descriptor.number)
    return status.st_dev, status.st_ino


def _make(
    name: str, size: int, lay_out: "Callable[[shm.native.Mapping], None]"
) -> "tuple[Descriptor, shm.native.Mapping]":
    if not size:
        raise ValueError(f"{name}: a size is out of bounds")
    claim(size)
    descriptor = Descriptor(set_aside(os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)))
    try:
        os.fchmod(descriptor.number, 0o600)  # a new memfd is open to all: a receiver could open it again
        os.ftruncate(descriptor.number, size)
        for start in range(0, size, _STEP_BYTES):
            if start:
                claim(size - start, of=size)  # other processes may take memory at the same time
            os.posix_fallocate(descriptor.number, start, min(_STEP_BYTES, size - start))
        memory = shm.native.Mapping(descriptor.number, size, writable=True)
        lay_out(memory)
        fcntl.fcntl(descriptor.number, fcntl.F_ADD_SEALS, SEALS)  # after the one writable mapping
    except BaseException:
        descriptor.close()  # at once, not when the traceback is freed
        raise
    return descriptor, memory


def _map(descriptor: Descriptor, find_fault: Callable[[int], str]) -> "shm.native.Mapping":
    if fault := find_fault(descriptor.number):
        raise ValueError(fault)
    return shm.native.Mapping(descriptor.number, os.fstat(descriptor.number).st_size)
