"""bus.transport.memory: buffers for data to be received."""

import mmap
from pathlib import Path

import pytest

from bus.transport.memory import room

pytestmark = pytest.mark.parametrize("core", ["yes", "no"])


@pytest.fixture(autouse=True)
def _core(core: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if core == "no":
        monkeypatch.setenv("BUS_NATIVE", "no")


def resident() -> int:
    """Resident memory of this process in bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE


def test_a_room_has_its_size() -> None:
    found = room(1000)
    assert type(found) is bytearray
    assert len(found) == 1000


def test_a_long_room_takes_no_memory_before_it_is_written() -> None:
    size = 64 << 20
    before = resident()
    found = room(size)
    assert len(found) == size
    assert resident() - before < size // 4
    found[:] = bytes(size)
    assert resident() - before > size // 2
