"""bus.shm: segments as busd makes them, in another process, and foreign segments with faults."""

import contextlib
import errno
import fcntl
import mmap
import os
import re
import resource
import select
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import shm
from bus.base.descriptor import Descriptor
from bus.shm import descriptors, segments
from conftest import WAIT_S
from effort import examples
from rows import for_each
from shm_ends import Listener, Talker, core

CAPACITY, INDEX = 4096, 16
RING_BYTES = descriptors.RING_LEAST_BYTES
MAX_WORD = 2**64 - 1


def test_whether_memory_can_be_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    monkeypatch.delenv("BUS_NATIVE", raising=False)
    assert shm.is_available(), shm.why_not()
    assert shm.native is core
    for name, value in (("BUS_ROUTE", "socket"), ("BUS_NATIVE", "no")):
        with monkeypatch.context() as context:
            context.setenv(name, value)
            assert shm.why_not() == f"{name}={value} is set"
            assert (shm.turned_off_by(), shm.advice()) == (name, f"unset {name}")
            assert not shm.is_available()
    assert (shm.turned_off_by(), shm.advice()) == ("", "")
    monkeypatch.setitem(sys.modules, "bus.shm._core", None)
    assert "not built" in shm.why_not()
    assert "BUS_NATIVE=yes" in shm.advice()
    monkeypatch.setattr(sys, "abiflags", "t")
    assert "free-threaded" in shm.why_not()
    assert "GIL" in shm.advice()


# --- as busd makes them


def test_segments_as_they_are_made() -> None:
    ring, memory = segments.make_ring(CAPACITY, INDEX, 7)
    assert memory.size == core.ring_bytes(CAPACITY, INDEX) == RING_BYTES
    assert descriptors.ring_fault(ring.number) == ""
    assert core.Writer(memory, 1).latest == 6
    readers, memory = segments.make_readers(1)
    assert memory.size == core.readers_bytes(1) == descriptors.READERS_LEAST_BYTES
    assert descriptors.readers_fault(readers.number) == ""
    doorbell = segments.make_doorbell()
    assert descriptors.doorbell_fault(doorbell.number) == ""
    assert not any(os.get_inheritable(one.number) for one in (ring, readers, doorbell))
    assert segments.identity(ring) == segments.identity(Descriptor(os.dup(ring.number)))
    assert segments.identity(ring) != segments.identity(readers)


def test_sizes_out_of_bounds() -> None:
    for capacity, index in ((4095, 16), (4096, 17), (2048, 16), (4096, 8), (1 << 35, 16), (0, 0)):
        assert core.ring_bytes(capacity, index) == 0
        with pytest.raises(ValueError, match="bounds"):
            segments.make_ring(capacity, index, 1)
    for first_seq in (0, 1 << 62):
        with pytest.raises(ValueError, match="bounds"):
            segments.make_ring(CAPACITY, INDEX, first_seq)
    for slots in (0, 65537):
        with pytest.raises(ValueError, match="bounds"):
            segments.make_readers(slots)
    with pytest.raises(OverflowError):
        core.ring_bytes(-1, 16)


def test_the_next_ring() -> None:
    """tests/native/test_sizes.c has all cases."""
    sizes = core.next_ring(4096, 21, 0, 1000, 64 << 20, keeps_all=False, must=False)
    assert sizes == (262144, 2048)
    assert core.next_ring(64 << 20, 21, 0, 1000, 64 << 20, keeps_all=False, must=False) is None
    with pytest.raises(ValueError, match="no ring has this capacity"):
        core.next_ring(0, 0, 0, 1, 0, keeps_all=False, must=True)
    assert core.is_filled_by_few(4096, 64)
    assert not core.is_filled_by_few(4096, 65)


def _seal_more(number: int) -> None:
    fcntl.fcntl(number, fcntl.F_ADD_SEALS, fcntl.F_SEAL_WRITE)


CHANGES: list[Callable[[int], object]] = [
    lambda number: mmap.mmap(number, 512, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE),
    lambda number: core.Mapping(number, 512, writable=True),
    lambda number: os.write(number, b"x"),
    lambda number: os.ftruncate(number, 0),
    lambda number: os.ftruncate(number, 1 << 20),
    _seal_more,
]


@for_each("change", CHANGES)
def test_nobody_can_write_to_it_or_resize_it_once_it_is_made(change: Callable[[int], object]) -> None:
    for descriptor, _ in (segments.make_ring(CAPACITY, INDEX, 1), segments.make_readers(4)):
        with pytest.raises(PermissionError):
            change(descriptor.number)


def test_a_foreign_mapping_is_no_end_to_write_with() -> None:
    talker, listener = Talker(), Listener()
    memory = segments.map_ring(talker.ring)
    for use in (
        lambda: core.Writer(memory, 1),
        lambda: talker.writer.move(memory),
        lambda: memory.format_ring(CAPACITY, INDEX, 1),
        lambda: core.Readers(segments.map_readers(listener.segment), 0),
    ):
        with pytest.raises(ValueError, match="read-only"):
            use()


@for_each("size", [RING_BYTES + 1, 0, -1])
def test_a_mapping_is_never_longer_than_its_file(size: int) -> None:
    ring, _ = segments.make_ring(CAPACITY, INDEX, 1)
    with pytest.raises(OSError, match=r".") as caught:
        core.Mapping(ring.number, size)
    assert caught.value.errno == errno.EINVAL


@contextlib.contextmanager
def limited(kind: int, soft: int) -> Iterator[None]:
    before = resource.getrlimit(kind)
    resource.setrlimit(kind, (soft, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(kind, before)


def test_out_of_descriptors_and_out_of_memory_are_errors() -> None:
    before = {entry.name for entry in Path("/proc/self/fd").iterdir()}
    ring, _ = segments.make_ring(CAPACITY, INDEX, 1)
    with limited(resource.RLIMIT_NOFILE, 3):
        for make in (segments.make_doorbell, lambda: segments.make_readers(1)):
            with pytest.raises(OSError, match="Too many open files"):
                make()
    with limited(resource.RLIMIT_AS, 1 << 20):
        for make in (lambda: segments.map_ring(ring), lambda: segments.make_ring(1 << 20, 512, 1)):  # type: ignore[assignment]
            with pytest.raises(OSError, match="memory"):
                make()
    ring.close()
    assert {entry.name for entry in Path("/proc/self/fd").iterdir()} == before


# --- another process

LISTENER = """
import select, socket, sys
from bus.base.descriptor import Descriptor
from bus import shm
from bus.shm import segments
ring, doorbell, line = (int(word) for word in sys.argv[1:])
segment, memory = segments.make_readers(1)
readers = shm.native.Readers(memory, doorbell)
reader = shm.native.Reader(readers, "me", 0, tells_cursor=False)
reader.attach(1, segments.map_ring(Descriptor(ring)), 0)
assert readers.sleep() == []
with socket.socket(fileno=line) as sock:
    socket.send_fds(sock, [b"x"], [segment.number])
taken = []
while len(taken) < 3:
    select.select([doorbell], [], [])
    readers.deliver(False)
    taken += reader.messages(9, bytes)
    while readers.sleep():
        taken += reader.messages(9, bytes)
print(taken)
"""


def test_another_process_sleeps_and_is_rung() -> None:
    talker, doorbell = Talker(), segments.make_doorbell()
    mine, other = socket.socketpair()
    with mine, other:
        mine.settimeout(WAIT_S)
        numbers = (talker.ring.number, doorbell.number, other.fileno())
        process = subprocess.Popen(
            [sys.executable, "-c", LISTENER, *map(str, numbers)], pass_fds=numbers, stdout=subprocess.PIPE
        )
        with process:
            _, (number,), _, _ = socket.recv_fds(mine, 1, 1)
            bell = core.Bell(segments.map_readers(Descriptor(number)), doorbell.number)
            talker.writer.add_gate(1, bell, 0, is_lossless=False)
            talker.write(b"one", b"two", b"three")
            output, _ = process.communicate(timeout=WAIT_S)
    assert output == b"[b'one', b'two', b'three']\n"
    assert talker.writer._debug()["rung"] >= 1
    assert not select.select([doorbell.number], [], [], 0)[0]


# --- with faults


def make_memfd(content: bytes, seals: int = descriptors.SEALS) -> Descriptor:
    descriptor = Descriptor(os.memfd_create("foreign", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
    os.write(descriptor.number, content)
    fcntl.fcntl(descriptor.number, fcntl.F_ADD_SEALS, seals)
    return descriptor


def regular_file() -> Descriptor:
    with tempfile.TemporaryFile() as file:
        file.truncate(1 << 16)
        return Descriptor(os.dup(file.fileno()))


def sparse_memfd() -> Descriptor:
    descriptor = Descriptor(os.memfd_create("foreign", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING))
    os.ftruncate(descriptor.number, 1 << 20)
    fcntl.fcntl(descriptor.number, fcntl.F_ADD_SEALS, descriptors.SEALS)
    return descriptor


@for_each("find_fault", [descriptors.ring_fault, descriptors.readers_fault])
@for_each(
    ("make", "words"),
    [
        (segments.make_doorbell, "no memfd"),
        (regular_file, "no memfd|lacks the seals"),
        (lambda: make_memfd(bytes(1 << 16), 0), "lacks the seals SHRINK, GROW, FUTURE_WRITE, SEAL"),
        (
            lambda: make_memfd(bytes(1 << 16), fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW),
            "lacks .* FUTURE_WRITE",
        ),
        (lambda: make_memfd(bytes(300)), "300 bytes, the least is"),
        (sparse_memfd, "not reserved"),
        (lambda: Descriptor(-1), "can't be looked at"),
    ],
)
def test_descriptors_that_are_no_segment(
    find_fault: Callable[[int], str], make: Callable[[], Descriptor], words: str
) -> None:
    descriptor = make()
    assert re.search(words, find_fault(descriptor.number))
    for map_it in (segments.map_ring, segments.map_readers):
        with pytest.raises(ValueError, match=words):
            map_it(descriptor)


def test_descriptors_that_are_no_doorbell() -> None:
    ring, _ = segments.make_ring(CAPACITY, INDEX, 1)
    blocking = Descriptor(os.eventfd(0, os.EFD_CLOEXEC))
    assert "no eventfd" in descriptors.doorbell_fault(ring.number)
    assert "would block" in descriptors.doorbell_fault(blocking.number)
    assert "can't be looked at" in descriptors.doorbell_fault(-1)


def test_a_segment_of_the_other_kind_is_refused() -> None:
    talker, listener = Talker(), Listener()
    with pytest.raises(ValueError, match="no readers' segment"):
        core.Bell(segments.map_readers(talker.ring), 0)
    with pytest.raises(ValueError, match="no ring"):
        listener.reader.attach(1, segments.map_ring(listener.segment), 0)


# --- lies: a ring whose maker may write any value into its words

WORDS = st.one_of(
    st.integers(0, MAX_WORD),
    st.sampled_from([0, 1, 2, 63, 64, 4095, 4096, 2**31, 2**32 - 1, 2**62, 2**63, MAX_WORD - 1, MAX_WORD]),
    st.integers(0, 200),
)
PLACES = st.one_of(st.integers(0, RING_BYTES // 8 - 1), st.integers(0, 80), st.integers(80, 120))


def honest_ring() -> bytes:
    """The bytes of a ring with some records in it."""
    talker = Talker(CAPACITY, INDEX)
    talker.write(*[b"%d" % number * 10 for number in range(20)])
    with mmap.mmap(talker.ring.number, RING_BYTES, mmap.MAP_SHARED, mmap.PROT_READ) as memory:
        return memory[:]


HONEST = honest_ring()


def read_all(ring: Descriptor) -> None:
    listener = Listener(depth=5)
    try:
        memory = segments.map_ring(ring)
        for source, options in enumerate(({"since_ns": 0}, {"start": 1}, {"history": 9, "since_ns": 2**62})):
            with contextlib.suppress(ValueError):
                listener.reader.attach(source, memory, source, **options)
                listener.reader.extend(source, memory)
        for depth in (0, 5, 1):
            listener.reader.depth = depth
            listener.reader.waiting()
            listener.readers.sleep()
            assert len(listener.take(500)) <= 500
        for source in range(3):
            listener.reader.finish(source)
        listener.take()
        assert all(isinstance(reason, str) for _, reason, _ in listener.reader.pop_left())
    finally:
        listener.close()
        ring.close()


def test_the_honest_ring_is_read() -> None:
    read_all(make_memfd(HONEST))


@given(st.dictionaries(PLACES, WORDS, min_size=1, max_size=6))
@settings(max_examples=examples(500))
def test_no_lie_in_a_ring_is_more_than_an_error(lies: dict[int, int]) -> None:
    content = bytearray(HONEST)
    for place, word in lies.items():
        struct.pack_into("<Q", content, 8 * place, word)
    read_all(make_memfd(bytes(content)))


@given(st.dictionaries(st.integers(0, 127), WORDS, min_size=1, max_size=6))
def test_no_lie_of_a_reader_is_more_than_an_error(lies: dict[int, int]) -> None:
    readers, memory = segments.make_readers(12)
    with mmap.mmap(readers.number, memory.size, mmap.MAP_SHARED, mmap.PROT_READ) as honest:
        content = bytearray(honest[:])
    for place, word in lies.items():
        struct.pack_into("<Q", content, 8 * place, word)
    liar = make_memfd(bytes(content))
    talker = Talker(CAPACITY, INDEX)
    with contextlib.suppress(ValueError):
        bell = core.Bell(segments.map_readers(liar), talker.doorbell.number)
        for slot in range(12):
            with contextlib.suppress(ValueError):  # the liar may claim fewer slots
                talker.writer.add_gate(slot, bell, slot, is_lossless=slot % 2 == 0)
        for _ in range(100):
            talker.writer.write(bytes(100))
        talker.writer.wait_for_room()
        assert 0 <= talker.writer._debug()["taken"] <= talker.writer.latest + 1
        talker.grow(1 << 14)
        for slot in range(12):
            talker.writer.has_pins(slot)
            talker.writer.remove_gate(slot)
        talker.write(bytes(100))
    talker.close()


def test_segments_can_be_opened_by_their_user_alone() -> None:
    talker, listener = Talker(), Listener()
    for descriptor in (talker.ring, listener.segment):
        assert os.fstat(descriptor.number).st_mode & 0o777 == 0o600
    talker.close()
    listener.close()
