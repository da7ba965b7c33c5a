"""Both ends of a ring in one process, mapped twice, for the tests of bus.shm."""

import os
from collections.abc import Iterator
from typing import Any

import pytest

from bus import shm
from bus.base.descriptor import Descriptor
from bus.shm import segments

pytest.importorskip("bus.shm._core", reason="the native core was not built")

core: Any = shm.native
"""Without types: tests pass invalid arguments."""

LARGE = 8192
"""The size of a payload that is pinned, not copied."""


class Talker:
    """A publisher's end."""

    def __init__(self, capacity: int = 1 << 18, index: int = 512, keep: int = 1, first_seq: int = 1) -> None:
        self.ring, memory = segments.make_ring(capacity, index, first_seq)
        self.writer = core.Writer(memory, keep)
        self.doorbell = segments.make_doorbell()

    def close(self) -> None:
        self.ring.close()
        self.doorbell.close()

    def write(self, *payloads: bytes) -> None:
        for payload in payloads:
            assert self.writer.write(payload) is True

    def lend_field(self, message: Any, index: int, size: int) -> Any:
        """The lent place itself, or the reason why there is none."""
        return self.writer.lend_field(message, index, size, lambda place, _: place, None)

    def grow(self, capacity: int, index: int = 512) -> Descriptor:
        ring, memory = segments.make_ring(capacity, index, self.writer.carry_from(1 << 30))
        self.writer.move(memory)
        self.ring = ring
        return ring


class Listener:
    """A reading process, with one reader."""

    def __init__(self, depth: int = 0, *, tells_cursor: bool = False) -> None:
        self.segment, memory = segments.make_readers(128)
        self.doorbell = segments.make_doorbell()
        self.readers = core.Readers(memory, self.doorbell.number)
        self.reader: shm.native.Reader[Any]
        self.reader = core.Reader(self.readers, self, depth, tells_cursor=tells_cursor)
        self.bell = core.Bell(segments.map_readers(self.segment), self.doorbell.number)
        self.slots = iter(range(128))

    def close(self) -> None:
        self.segment.close()
        self.doorbell.close()

    def join(self, talker: Talker, source: Any = 1, *, gate: bool = True, **options: Any) -> int:
        """Attach and be admitted; returns the slot."""
        slot = next(self.slots)
        doorbell = talker.doorbell.number
        self.reader.attach(source, segments.map_ring(talker.ring), slot, doorbell=doorbell, **options)
        if gate:
            talker.writer.add_gate(id(self), self.bell, slot, is_lossless=bool(options.get("start")))
        return slot

    def take(self, limit: int = 1000) -> list[Any]:
        return self.reader.messages(limit, bytes)


def is_rung(doorbell: Descriptor) -> bool:
    try:
        os.eventfd_read(doorbell.number)
    except BlockingIOError:
        return False
    return True


@pytest.fixture
def talker() -> Iterator[Talker]:
    end = Talker()
    yield end
    end.close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    end = Listener()
    yield end
    end.close()
