"""busd.server.strangers: a file that takes long to close blocks only a thread."""

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


def files(number: int) -> list[int]:
    """Descriptors of files that another process may own."""
    return [os.open(__file__, os.O_RDONLY) for _ in range(number)]


def _open() -> int:
    """The number of descriptors that this process has open."""
    return len(list(Path("/proc/self/fd").iterdir()))


class Owner:
    """An owner of files. None of them is closed before `let_go`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._may = threading.Event()
        self._close = os.closerange
        monkeypatch.setattr(module.os, "closerange", self._wait)  # type: ignore[attr-defined]

    def let_go(self) -> None:
        self._may.set()

    def _wait(self, first: int, end: int) -> None:
        self._may.wait()
        self._close(first, end)


@pytest.fixture
def owner(monkeypatch: pytest.MonkeyPatch) -> Iterator[Owner]:
    made = Owner(monkeypatch)
    yield made
    made.let_go()
    wait_until(lambda: not strangers.waiting)


@contextlib.contextmanager
def nothing_left() -> Iterator[None]:
    """Everything opened within is closed at the end."""
    before = _open()
    yield
    wait_until(lambda: _open() <= before)


class TestAdopt:
    def test_what_closes_at_once_is_no_stranger(self) -> None:
        with nothing_left():
            for one in (memfd(), memfd(seals=0), eventfd()):
                assert type(strangers.adopt(os.dup(one.fileno()))) is Descriptor
            del one
            for number in (*os.pipe(), socket.socket(socket.AF_UNIX).detach()):
                assert type(strangers.adopt(number)) is Descriptor

    def test_all_else_is(self, owner: Owner, tmp_path: Path) -> None:
        false = tmp_path / "memfd:ring"
        false.touch()
        numbers = [*files(1), os.open("/", os.O_PATH), os.open(false, os.O_RDWR), socket.socket().detach()]
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
            strangers.drop(files(100))

    def test_a_socket_does_not_linger(self) -> None:
        with nothing_left(), lingering_socket() as lingering:
            strangers.adopt(os.dup(lingering.fileno())).close()
            wait_until(lambda: not strangers.waiting)
            lingering.close()

    def test_the_slow_hold_up_neither_the_caller_nor_others(self, owner: Owner) -> None:
        with nothing_left():
            strangers.drop(files(10))
            assert strangers.waiting == 10
            assert strangers.room
            owner.let_go()

    def test_there_are_so_many_and_no_more(
        self, owner: Owner, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        monkeypatch.setattr(module, "_MOST", 20)
        with nothing_left():
            strangers.drop(files(20))
            assert strangers.room == 0
            strangers.drop(files(2))
            assert [one.message for one in caplog.records] == [
                "20 descriptors of strange files block on close: busd accepts no more of them"
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

    @pytest.mark.parametrize("messages", [0, 3, 50])
    def test_a_connection_that_ends_is_emptied(self, messages: int) -> None:
        """If it holds much, a thread does this."""
        mine, other = socket.socketpair()
        with nothing_left(), other:
            ends = []
            for _ in range(messages):
                reading, writing = os.pipe()
                socket.send_fds(other, [b"x"], [writing])
                os.close(writing)
                ends.append(reading)
            strangers.finish(mine)
            for reading in ends:
                assert os.read(reading, 1) == b""
                os.close(reading)
            assert other.recv(1) == b""

    def test_also_after_a_reset(self) -> None:
        mine, other = socket.socketpair()
        with nothing_left():
            for reading, writing in (os.pipe() for _ in range(50)):
                socket.send_fds(other, [b"x"], [reading, writing])
                os.close(reading)
                os.close(writing)
            mine.send(b"unread")
            other.close()
            strangers.finish(mine)


def test_the_room_is_for_all_that_the_kernel_passes_at_once() -> None:
    assert strangers.room == socket.CMSG_SPACE(253 * array.array("i").itemsize)
