"""Descriptors that peers send: separate threads close descriptors of strange files.

Closing a file can take as long as its owner likes: a file of a file system in a user's process (FUSE), a TCP
socket with SO_LINGER and unread bytes. That is also true if the kernel closes descriptors that were not
received or not read. So busd receives all descriptors that come with the data that it reads, and empties a
connection before it closes it. busd itself closes files that are known to close at once: a thread costs more.
Owns which files are strange, and the threads. Must not know which messages bring descriptors.

At most `_MOST` files wait to be closed. If that many do and none is closed within `_PATIENCE_S`, the kernel
closes new ones. In this case it does not wait for file systems, but it does for sockets that linger.
"""

import fcntl
import logging
import os
import socket
import struct
from array import array
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from threading import Condition, Thread

from bus.base.descriptor import Descriptor

__all__ = ["Stranger", "Strangers", "strangers"]

_log = logging.getLogger("busd")

_MOST_AT_ONCE = 253  # SCM_MAX_FD: the kernel passes no more with one message
_ANCILLARY_BYTES = socket.CMSG_SPACE(_MOST_AT_ONCE * array("i").itemsize)
_CLOSE_ON_EXEC = int(getattr(socket, "MSG_CMSG_CLOEXEC", 0))  # Linux
_GET_SEALS = 1034  # Linux's number; the module fcntl has it there only
_QUICK = ("anon_inode:", "pipe:", "/memfd:")
"""The kernel's names for files on which no other process has an influence."""
_NO_LINGER = struct.pack("ii", 0, 0)
_SCRAP_BYTES = 64 << 10
_FEW = 2
_MOST = 1024
"""Files that wait to be closed, or are being closed."""
_MOST_THREADS = 32
_PATIENCE_S = 0.005


class Stranger(Descriptor):
    """A descriptor of a file that may take its time to close: `close` has a thread do it."""

    __slots__ = ()

    def close(self) -> None:
        number, self.number = self.number, -1
        if number >= 0:
            strangers.hand_over((number,))


class Strangers:
    """Takes descriptors (`bus.transport.stream.Taker`).

    Threads close strange files: one more if all are busy, and none while there is nothing to do.
    """

    def __init__(self) -> None:
        self.room = _ANCILLARY_BYTES
        self.waiting = 0
        """Files that are yet to be closed."""
        self._threads = 0
        self._queue: deque[Sequence[int] | socket.socket] = deque()
        self._changed = Condition()

    def adopt(self, number: int) -> Descriptor:
        """The owner of a descriptor that has just come."""
        return Stranger(number) if _is_strange(number) else Descriptor(number)

    def drop(self, numbers: Sequence[int]) -> None:
        """Close received descriptors. If there are many, a thread closes them all, without a check."""
        if len(numbers) > _FEW:
            self.hand_over(numbers)
        else:
            for number in numbers:
                self.adopt(number).close()

    def receive(self, sock: socket.socket, count: int) -> bytes:
        """Up to `count` bytes, without waiting; closes descriptors that come with them. Raises OSError."""
        received, numbers = self._receive(sock, count)
        self.drop(numbers)
        return received

    def finish(self, sock: socket.socket) -> None:
        """Read the remaining data, and close `sock`; the other side can send no more from now on."""
        with suppress(OSError):
            sock.shutdown(socket.SHUT_RDWR)
        numbers = self._next_numbers(sock)
        if numbers is None:
            sock.close()
        else:
            self.drop(numbers)
            self.hand_over(sock)

    def hand_over(self, files: Sequence[int] | socket.socket) -> None:
        """Have a thread close these. If too many wait for that, wait a moment for one."""
        with self._changed:
            self.waiting += _count(files)
            self._queue.append(files)
            is_thread_needed = self._threads < min(self.waiting, _MOST_THREADS)
            self._threads += is_thread_needed
        if is_thread_needed:
            try:
                Thread(target=self._work, name="busd-closer", daemon=True).start()
            except RuntimeError:  # there can be none now; the next call tries again
                with self._changed:
                    self._threads -= 1
        if self.waiting >= _MOST and self.room:
            self._wait_for_room()

    def _receive(self, sock: socket.socket, count: int) -> tuple[bytes, Sequence[int]]:
        received, ancillary, _, _ = sock.recvmsg(count, self.room, socket.MSG_DONTWAIT | _CLOSE_ON_EXEC)
        numbers = array("i")
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS:
                numbers.frombytes(content[: len(content) // numbers.itemsize * numbers.itemsize])
        return received, numbers

    def _next_numbers(self, sock: socket.socket) -> Sequence[int] | None:
        """Read `sock` up to a piece that brings descriptors; None: that was all."""
        while True:
            try:
                received, numbers = self._receive(sock, _SCRAP_BYTES)
            except ConnectionResetError:
                continue  # the kernel reports this once, before the data
            except OSError:
                return None
            if numbers or not received:
                return numbers or None

    def _wait_for_room(self) -> None:
        with self._changed:
            before = self.waiting
            self._changed.wait_for(lambda: self.waiting < before, _PATIENCE_S)
            if self.waiting < before:
                return
            self.room = 0
        _log.warning("%d descriptors of strange files block on close: busd accepts no more of them", before)

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._queue:
                    self._threads -= 1
                    return
                files = self._queue.popleft()
            if isinstance(files, socket.socket):
                while numbers := self._next_numbers(files):
                    _close(numbers)
                files.close()
            else:
                _close(files)
            with self._changed:
                self.waiting -= _count(files)
                if self.waiting < _MOST:
                    self.room = _ANCILLARY_BYTES
                self._changed.notify()


def _is_strange(number: int) -> bool:
    """Whether other processes can influence how long it takes to close that file."""
    try:
        kind = os.readlink(f"/proc/self/fd/{number}")  # noqa: PTH115
        if kind.startswith("/memfd:"):
            fcntl.fcntl(number, _GET_SEALS)  # no file of that name
        elif kind.startswith("socket:"):
            sock = socket.socket(fileno=number)
            sock.detach()
            return sock.family != socket.AF_UNIX
    except OSError:
        return True
    return not kind.startswith(_QUICK)


def _count(files: Sequence[int] | socket.socket) -> int:
    return 1 if isinstance(files, socket.socket) else len(files)


def _close(numbers: Sequence[int]) -> None:
    """Sockets do not linger. Neighbours are closed in one call: another thread waits for the end of each."""
    rows: list[list[int]] = []
    for number in sorted(numbers):
        with suppress(OSError):
            sock = socket.socket(fileno=number)
            with suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
            sock.detach()
        if rows and number == rows[-1][1]:
            rows[-1][1] += 1
        else:
            rows.append([number, number + 1])
    for first, end in rows:
        os.closerange(first, end)


strangers = Strangers()
"""Shared by all connections: descriptors belong to the process."""
