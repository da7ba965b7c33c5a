"""bus.base.buffers: only written pages use memory, and the last view frees it."""

import errno
import gc
import mmap
import os
from pathlib import Path

import pytest

from bus.base.buffers import paged_buffer, zeroed_buffer

SIZE = 32 << 20


def resident() -> int:
    """Resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE


def fill(buffer: memoryview) -> None:
    for start in range(0, len(buffer), mmap.PAGESIZE):
        buffer[start] = 1


def test_all_zeros_and_writable() -> None:
    buffer = paged_buffer(3 * mmap.PAGESIZE + 5)
    assert len(buffer) == 3 * mmap.PAGESIZE + 5
    assert not any(buffer)
    buffer[-2:] = b"ab"
    assert bytes(buffer[-3:]) == b"\0ab"


def test_memory_comes_with_writing_and_goes_with_the_last_view() -> None:
    before = resident()
    buffer = paged_buffer(SIZE)
    buffer[:100] = bytes(100)
    assert resident() - before < SIZE // 2
    fill(buffer)
    assert resident() - before > SIZE // 2
    part = buffer[1000:]
    del buffer
    assert part[-1] == 0
    assert resident() - before > SIZE // 2
    del part
    assert resident() - before < SIZE // 2


@pytest.mark.parametrize("size", [1000, SIZE])
def test_a_zeroed_buffer_is_quickly_there(size: int) -> None:
    before = resident()
    buffer = zeroed_buffer(size)
    assert len(buffer) == size
    assert not any(buffer[:1000])
    assert resident() - before < SIZE // 2


def test_garbage_in_a_cycle_gives_its_memory_back() -> None:
    before = resident()
    cycle: list[object] = [paged_buffer(SIZE)]
    cycle.append(cycle)
    fill(cycle[0])  # type: ignore[arg-type]
    assert resident() - before > SIZE // 2
    del cycle
    gc.collect()
    assert resident() - before < SIZE // 2


def test_a_child_process_has_its_own() -> None:
    buffer = paged_buffer(mmap.PAGESIZE)
    buffer[0] = 1
    child = os.fork()
    if not child:
        seen = buffer[0]
        buffer[0] = 2
        os._exit(seen)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1
    assert buffer[0] == 1


def test_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> mmap.mmap:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr(mmap, "mmap", refuse)
    with pytest.raises(MemoryError, match="4096 bytes for a buffer: Cannot allocate memory"):
        paged_buffer(4096)
