"""busd.server.strangers: a file that takes long to close holds up nobody but a thread."""

import array
import contextlib
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.base.descriptor import Descriptor
from busd.server import strangers as module
from busd.server.strangers import Stranger, strangers
from lingering import lingering_socket
from neighbours import wait_until
from raw_sharing import eventfd, memfd


def pipes(number: int) -> list[int]:
    """Descriptors of files that are none of ours."""
    made: list[int] = []
    while len(made) < number:
        made += os.pipe()
    return made


def _open() -> int:
    """How many descriptors this process has."""
    return len(list(Path("/proc/self/fd").iterdir()))


class Owner:
    """Of files: nothing is closed before `let_go`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._may = threading.Event()
        self._close = os.close
        monkeypatch.setattr(module.os, "close", self._wait)  # type: ignore[attr-defined]

    def let_go(self) -> None:
        self._may.set()

    def _wait(self, number: int) -> None:
        if threading.current_thread().name == "busd-closer":
            self._may.wait()
        self._close(number)


@pytest.fixture
def owner(monkeypatch: pytest.MonkeyPatch) -> Iterator[Owner]:
    made = Owner(monkeypatch)
    yield made
    made.let_go()
    wait_until(lambda: not strangers.waiting)


@contextlib.contextmanager
def nothing_left() -> Iterator[None]:
    """Within, what is opened is closed."""
    before = _open()
    yield
    wait_until(lambda: _open() <= before)


class TestAdopt:
    def test_what_is_shared_is_no_stranger(self) -> None:
        with nothing_left():
            for one in (memfd(), memfd(seals=0), eventfd()):
                assert type(strangers.adopt(os.dup(one.fileno()))) is Descriptor
            del one

    def test_all_else_is(self, owner: Owner) -> None:
        """Also without a seal, or where nothing can be asked of it."""
        numbers = [*pipes(2), os.open("/", os.O_PATH), socket.socket().detach()]
        for number in numbers:
            adopted = strangers.adopt(number)
            assert type(adopted) is Stranger
            adopted.close()
            assert adopted.fileno() == -1
            adopted.close()
        assert strangers.waiting == len(numbers)


class TestDrop:
    def test_all_are_closed(self) -> None:
        with nothing_left():
            strangers.drop(pipes(100))

    def test_a_socket_does_not_linger(self) -> None:
        with nothing_left(), lingering_socket() as lingering:
            strangers.adopt(os.dup(lingering.fileno())).close()
            wait_until(lambda: not strangers.waiting)
            lingering.close()

    def test_the_slow_hold_up_neither_the_caller_nor_others(self, owner: Owner) -> None:
        with nothing_left():
            strangers.drop(pipes(10))
            assert strangers.waiting == 10
            assert strangers.room
            owner.let_go()

    def test_there_are_so_many_and_no_more(
        self, owner: Owner, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        monkeypatch.setattr(module, "_MOST", 20)
        with nothing_left():
            strangers.drop(pipes(20))
            assert strangers.room == 0
            strangers.drop(pipes(2))
            assert [one.message for one in caplog.records] == [
                "20 descriptors of strange files can't be closed: no more are taken"
            ]
            owner.let_go()
            wait_until(lambda: strangers.room)


class TestReceive:
    def test_descriptors_beside_bytes_are_closed(self) -> None:
        mine, other = socket.socketpair()
        with nothing_left(), mine, other:
            reading, writing = os.pipe()
            socket.send_fds(other, [b"hello"], [reading, writing] * 100)
            assert strangers.receive(mine, 3) == b"hel"
            assert strangers.receive(mine, 3) == b"lo"
            os.close(writing)
            wait_until(lambda: not strangers.waiting)
            assert os.read(reading, 1) == b""
            os.close(reading)

    def test_all_that_is_left_is_read(self) -> None:
        mine, other = socket.socketpair()
        with nothing_left(), mine, other:
            for _ in range(50):
                reading, writing = os.pipe()
                socket.send_fds(other, [b"x"], [reading, writing])
                os.close(reading)
                os.close(writing)
            mine.send(b"unread: its end will be a reset")
            other.close()
            strangers.empty(mine)
            assert mine.recv(1) == b""


def test_the_room_is_for_all_that_the_kernel_passes_at_once() -> None:
    assert strangers.room == socket.CMSG_SPACE(253 * array.array("i").itemsize)
