"""Descriptors that peers send: those of strange files are closed in threads of their own.

To close a file can take as long as its owner likes: a file of a file system in a user's process (FUSE), a TCP
socket with SO_LINGER and bytes that nobody reads. That holds, too, where the kernel closes what was not
received or not read. So busd receives all descriptors that come with what it reads, and empties a connection
before it closes it. Owns which files are strange, and the threads. Must not know which messages bring
descriptors.

No more than `_MOST` wait to be closed. Where that many do, and none of them is closed within `_PATIENCE_S`,
the kernel closes what comes: it does not wait for file systems then, but for sockets that linger.
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
_EVENTFD = "anon_inode:[eventfd]"
_NO_LINGER = struct.pack("ii", 0, 0)
_SCRAP_BYTES = 64 << 10
_MOST = 1024
"""Descriptors that wait to be closed, or are being closed."""
_MOST_THREADS = 32
_PATIENCE_S = 0.005


class Stranger(Descriptor):
    """A descriptor of a file that may take its time to close: `close` has a thread do it."""

    __slots__ = ()

    def close(self) -> None:
        number, self.number = self.number, -1
        if number >= 0:
            strangers.drop((number,))


class Strangers:
    """Takes descriptors (`bus.transport.stream.Taker`). Threads close them: one more where all are busy, and
    none while there is nothing to do."""

    def __init__(self) -> None:
        self.room = _ANCILLARY_BYTES
        self.waiting = 0
        """Descriptors that are yet to be closed."""
        self._threads = 0
        self._numbers: deque[int] = deque()
        self._changed = Condition()

    def adopt(self, number: int) -> Descriptor:
        """The owner of a descriptor that has just come."""
        try:
            fcntl.fcntl(number, _GET_SEALS)
            return Descriptor(number)  # a memfd, or another file that is in memory
        except OSError:
            pass
        with suppress(OSError):
            if os.readlink(f"/proc/self/fd/{number}") == _EVENTFD:  # noqa: PTH115
                return Descriptor(number)
        return Stranger(number)

    def drop(self, numbers: Sequence[int]) -> None:
        """Close descriptors that have come, soon. Where too many wait for that, wait a moment for one."""
        with self._changed:
            self.waiting += len(numbers)
            self._numbers.extend(numbers)
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

    def receive(self, sock: socket.socket, count: int) -> bytes:
        """Up to `count` bytes, without waiting; closes descriptors that come with them. Raises OSError."""
        received, ancillary, _, _ = sock.recvmsg(count, self.room, socket.MSG_DONTWAIT | _CLOSE_ON_EXEC)
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS:
                numbers = array("i")
                numbers.frombytes(content[: len(content) // numbers.itemsize * numbers.itemsize])
                self.drop(numbers)
        return received

    def empty(self, sock: socket.socket) -> None:
        """Read all that is left, before `sock` is closed; the other side can send no more from now on."""
        with suppress(OSError):
            sock.shutdown(socket.SHUT_RDWR)
        while True:
            try:
                if not self.receive(sock, _SCRAP_BYTES):
                    return
            except ConnectionResetError:
                pass  # is told once, before what there is to read
            except OSError:
                return

    def _wait_for_room(self) -> None:
        with self._changed:
            before = self.waiting
            self._changed.wait_for(lambda: self.waiting < before, _PATIENCE_S)
            if self.waiting < before:
                return
            self.room = 0
        _log.warning("%d descriptors of strange files can't be closed: no more are taken", before)

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._numbers:
                    self._threads -= 1
                    return
                number = self._numbers.popleft()
            _close(number)
            with self._changed:
                self.waiting -= 1
                if self.waiting < _MOST:
                    self.room = _ANCILLARY_BYTES
                self._changed.notify()


def _close(number: int) -> None:
    """A socket does not linger."""
    with suppress(OSError):
        sock = socket.socket(fileno=number)
        with suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)
        sock.detach()
    with suppress(OSError):
        os.close(number)


strangers = Strangers()
"""Of this process, whose descriptors they are."""
