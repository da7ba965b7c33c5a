"""Rings of a publisher that writes arbitrary data, and readers of them. Needs the native core."""

import mmap
import os
from contextlib import suppress
from fcntl import F_ADD_SEALS, fcntl
from functools import partial
from typing import Any

import msgspec

from bus import shm
from bus.base.descriptor import Descriptor
from bus.msg.std_msgs import String
from bus.shm import segments
from bus.shm.descriptors import SEALS
from bus.wire.layout import MAX_COUNT
from fuzz.native_targets import check_pack
from fuzz.script import Script

_HEADER_BYTES = 640
_HEADER_WORDS = (16, 32, 33, 48, 49, 64, 65, 66)
"""From layout.h: oldest, latest, end, the bell, closed and the first tickets."""
_GEOMETRY_WORDS = 9
_LARGE = 6000
"""The size of a payload that is pinned, not copied."""


class HostileRing:
    """A ring with some records and some wrong words; sealed correctly."""

    def __init__(self, script: Script) -> None:
        self.capacity, self.index = (4096, 32768)[script.byte() % 2], 16 << script.byte() % 3
        size = shm.native.ring_bytes(self.capacity, self.index)
        self.descriptor = Descriptor(os.memfd_create("fuzz", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
        os.posix_fallocate(self.descriptor.number, 0, size)
        self._words = memoryview(mmap.mmap(self.descriptor.number, size)).cast("Q")
        own = shm.native.Mapping(self.descriptor.number, size, writable=True)
        own.format_ring(self.capacity, self.index, 1 + script.byte() % 4)
        self.writer = shm.native.Writer(own, 1)
        for _ in range(script.byte() % 8):
            self.write(script)
        for _ in range(script.byte() % 4):
            self.scribble(script)
        if script.byte() % 8 == 1:
            self._words[script.byte() % _GEOMETRY_WORDS] = script.number(size, signed=False)
        fcntl(self.descriptor.number, F_ADD_SEALS, SEALS if script.byte() < 250 else 0)

    def pass_on(self) -> Descriptor:
        """A descriptor of it for another process."""
        return Descriptor(os.dup(self.descriptor.number))

    def write(self, script: Script) -> None:
        """Write a message as an honest publisher does."""
        size = script.byte()
        self.writer.write(msgspec.msgpack.encode(String(data="x" * (_LARGE if size == 255 else size))))

    def scribble(self, script: Script) -> None:
        """Change a word that readers look at, or any other."""
        kind, where = script.byte(), script.byte()
        index_at = _HEADER_BYTES // 8
        match kind % 4:
            case 0:
                at = _HEADER_WORDS[where % len(_HEADER_WORDS)]
            case 1:
                at = index_at + where % self.index
            case 2:
                at = index_at + self.index + where % (self.capacity // 64) * 8 + kind // 4 % 3
            case _:
                at = where * script.byte() % len(self._words)
        self._words[at] = script.number(self._words[at], signed=False)


def reader(data: bytes) -> None:
    """A subscription's reader on up to four such rings, which change while it reads."""
    script = Script(data)
    segment, memory = segments.make_readers(8)
    doorbell = segments.make_doorbell()
    readers = shm.native.Readers(memory, doorbell.number)
    keeps_all = bool(script.byte() & 1)
    taker: shm.native.Reader[int] = shm.native.Reader(
        readers, "owner", 0 if keeps_all else 1 + script.byte() % 8, tells_cursor=keeps_all
    )
    bell = shm.native.Bell(segments.map_readers(segment), doorbell.number)
    there: list[HostileRing] = []
    held: list[Any] = []
    taker.prepare(held.append, _hold, held.append, (), int)
    while script:
        act, source = script.byte() % 12, script.byte() % 4
        match act:
            case 0 | 1:
                there.append(HostileRing(script))
                with suppress(ValueError):
                    memory = segments.map_ring(there[-1].descriptor)
                    if act == 1 and taker.next_seq(source):
                        taker.extend(source, memory)
                    else:
                        slot = script.byte() % 8
                        history, start = script.byte() % 4, script.number(signed=False)
                        since_ns = 0 if script.byte() & 1 else 1 << 62
                        lifespan_ns = 1 if script.byte() > 240 else 0
                        taker.attach(
                            source, memory, slot, start=start, since_ns=since_ns, history=history,
                            lifespan_ns=lifespan_ns, doorbell=doorbell.number,
                        )  # fmt: skip
                        there[-1].writer.add_gate(source, bell, slot, is_lossless=keeps_all)
            case 2 | 3:
                if there:
                    there[source % len(there)].scribble(script)
            case 4:
                if there:
                    there[source % len(there)].write(script)
            case 5 | 6:
                held += taker.messages(1 + script.byte() % 8, _hold)
            case 7:
                held += taker.take(1 + script.byte() % 8, _decode)
            case 8:
                looks = (
                    partial(readers.deliver, False),
                    readers.sleep,
                    partial(readers.deliver, True),
                    partial(readers.look, 0),
                )
                looks[source]()
            case 9:
                taker.finish(source)
            case 10:
                taker.detach(source)
            case _:
                held.clear()
                if source:
                    most_bytes, longest = 64 * script.byte(), 64 * script.byte()
                    take = taker.take_merged if source % 2 else taker.take_packed
                    check_pack(take(most_bytes, longest, 1 << 60), most_bytes, longest)
        _check(taker)


def _hold(payload: Any) -> Any:
    return bytes(payload), payload  # a payload that is a view keeps the record in its place


_decode = msgspec.msgpack.Decoder(String).decode


def _check(reader: Any) -> None:
    assert 0 <= reader.waiting() <= MAX_COUNT
    reader.pop_rejected()
    for _, reason, next_seq in reader.pop_left():
        assert isinstance(reason, str)
        assert next_seq >= 0
