"""bus.shm.openfiles: descriptors get numbers that the program can spare, and some numbers are left to it."""

import contextlib
import errno
import os
import resource
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.base.descriptor import Descriptor
from bus.shm import has_core, openfiles, segments
from bus.shm.openfiles import OWN, RESERVE
from rows import for_each

pytestmark = pytest.mark.skipif(not has_core(), reason="the native core was not built")

FILES = resource.RLIMIT_NOFILE


@contextlib.contextmanager
def limited(soft: int) -> Iterator[None]:
    before = resource.getrlimit(FILES)
    if before[1] < 4096:
        pytest.skip("the hard limit is lower")
    resource.setrlimit(FILES, (soft, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(FILES, before)


@contextlib.contextmanager
def with_room_for(room: int) -> Iterator[None]:
    """Set the limit to `room` more than the open files. It looks like the hard limit, which cannot be raised
    again.
    """
    limit = used() + room
    with limited(limit), pytest.MonkeyPatch.context() as patch:
        patch.setattr(resource, "getrlimit", lambda _: (limit, limit))
        yield


def used() -> int:
    return len(os.listdir("/proc/self/fd")) - 1  # noqa: PTH208


def make() -> Descriptor:
    return segments.make_ring(4096, 64, 1)[0]


def opened(count: int) -> list[Descriptor]:
    return [Descriptor(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)) for _ in range(count)]


@for_each("soft", [256, 1024, 1500])
def test_rings_take_none_of_the_programs_numbers(soft: int) -> None:
    with limited(soft):
        rings = [make() for _ in range(3)]
        assert resource.getrlimit(FILES)[0] == soft
        files = opened(5)
    assert all(ring.number >= 1024 for ring in rings)
    assert all(file.number < min(soft, 1024) for file in files)
    assert not any(os.get_inheritable(ring.number) for ring in rings)


def test_beyond_the_soft_limit_once_the_program_would_miss_them_below() -> None:
    with limited(1024 + 10):
        rings = [make() for _ in range(20)]
        numbers = {ring.number for ring in rings}
        assert min(numbers) == 1024
        assert max(numbers) >= 1034
        files = opened(1034 - RESERVE - used())
        assert make().number >= 1034  # the lower numbers are the reserve
    del files


def test_with_no_better_place_they_stay_where_they_are() -> None:
    with with_room_for(RESERVE + 20):
        lowest = opened(1)[0].number
        assert make().number == lowest


def test_a_system_that_lets_nobody_raise_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    with limited(512):
        monkeypatch.setattr(resource, "setrlimit", refuse)
        number = make().number
        monkeypatch.undo()
    assert number < 512


def test_a_limit_that_another_thread_sets_meanwhile_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = openfiles._moved

    def set_meanwhile(number: int, least: int) -> int | None:
        resource.setrlimit(FILES, (600, resource.getrlimit(FILES)[1]))
        return moved(number, least)

    with limited(512):
        monkeypatch.setattr(openfiles, "_moved", set_meanwhile)
        make()
        assert resource.getrlimit(FILES)[0] == 600


def test_a_reserve_is_left() -> None:
    with with_room_for(OWN + RESERVE + 3):
        rings = []
        for _ in range(3):
            openfiles.check_room()
            rings.append(make())
        with pytest.raises(OSError, match=r"\d+ of \d+ descriptors are in use, the rest is left") as error:
            openfiles.check_room()
        assert error.value.errno == errno.EMFILE
        assert len(opened(OWN + RESERVE)) == OWN + RESERVE
        rings.pop().close()
        openfiles.check_room()


@pytest.mark.parametrize("lack", ["size", "folder"])
def test_where_the_kernel_does_not_say_how_many_are_open(monkeypatch: pytest.MonkeyPatch, lack: str) -> None:
    """Linux before 6.2 has only the list of open files. Without /proc, the lowest free number shows how many
    are open.
    """
    known = openfiles._used()
    assert known in (used(), used() + 1)
    stat = os.stat

    def look(path: str) -> object:
        if lack == "folder":
            raise FileNotFoundError(errno.ENOENT, "No such file or directory")
        return stat("/proc/self/limits")  # its size is 0

    monkeypatch.setattr(openfiles.os, "stat", look)  # type: ignore[attr-defined]
    found = openfiles._used()
    monkeypatch.undo()
    assert 3 <= found <= known + 1
    assert lack == "folder" or found >= known


def test_select_works_beside_many_rings() -> None:
    rings = [make() for _ in range(200)]
    reading, writing = os.pipe()
    try:
        os.write(writing, b"x")
        assert select.select([reading], [], [], 0)[0] == [reading]
    finally:
        os.close(reading)
        os.close(writing)
    assert len({ring.number for ring in rings}) == 200


def test_children_have_the_programs_own_limit() -> None:
    with limited(700):
        make()
        said = subprocess.check_output(
            [sys.executable, "-c", "import resource; print(resource.getrlimit(resource.RLIMIT_NOFILE)[0])"]
        )
    assert said == b"700\n"


def test_nothing_is_left_open() -> None:
    before = {entry.name for entry in Path("/proc/self/fd").iterdir()}
    with limited(512):
        make().close()
    assert {entry.name for entry in Path("/proc/self/fd").iterdir()} == before
