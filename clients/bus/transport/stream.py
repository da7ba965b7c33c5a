"""One UNIX stream socket on the event loop: reads into a Session, sends from an Outbox.

Works on the bare descriptor with add_reader and add_writer, because what is published must leave at once,
not at the end of the loop's turn. Must not know what the messages mean.

A frame's descriptors go with its first byte, in a call of its own (SCM_RIGHTS). The kernel ends a read with
the piece that carries descriptors, so one read brings one batch at most.
"""

import asyncio
import errno
import select
import socket
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, Protocol

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.transport.hangups import HangUps
from bus.transport.memory import keep_freed_memory
from bus.wire.framing import BUFFER_BYTES
from bus.wire.outbox import Outbox
from bus.wire.runs import Buffer
from bus.wire.session import Session

_SHORT_BYTES = 4096
_LONG_BYTES, _WIDE_BYTES = 64 << 10, 208 << 10
_HUGE_BYTES, _WIDEST_BYTES = 512 << 10, 1 << 20
"""A stream that sends so much at a time asks the kernel for so much room. The kernel doubles it, and reports
room again when three quarters are free. By default a socket has 208 KiB, three long runs, and the kernel
gives twice that at most, or what the administrator allows (net.core.wmem_max)."""
_MOST_WORK = 512
"""What one `flush` sends at most, in the work that it costs; the rest goes in later turns of the loop."""
_DESCRIPTORS_WORK = 8
_RETRY_S = 0.05
_INT = struct.Struct("i")
_MOST_DESCRIPTORS = 2
"""That a message brings."""
_TOO_MANY_DESCRIPTORS = 16
_ANCILLARY_BYTES = socket.CMSG_SPACE(_MOST_DESCRIPTORS * _INT.size)
_CLOSE_ON_EXEC = int(getattr(socket, "MSG_CMSG_CLOEXEC", 0))  # Linux
_CUT_OFF = int(socket.MSG_CTRUNC)  # as a number: socket's own flags are ten times as slow


class Taker(Protocol):
    """Takes the descriptors that come."""

    room: int
    """How many bytes the kernel may fill with them at one read; what has no room there, it closes."""

    def adopt(self, number: int) -> Descriptor:
        """The owner of one that a message may claim."""

    def drop(self, numbers: Sequence[int]) -> None:
        """Close these, which no message can claim."""

    def finish(self, sock: socket.socket) -> None:
        """Read what is left, which nobody wants any more, and close it."""


class _Trusting:
    """For a side that sends nothing strange."""

    room = _ANCILLARY_BYTES

    def adopt(self, number: int) -> Descriptor:
        return Descriptor(number)

    def drop(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            Descriptor(number).close()

    def finish(self, sock: socket.socket) -> None:
        with suppress(OSError), sock:
            sock.shutdown(socket.SHUT_RDWR)
            while sock.recv(BUFFER_BYTES):
                pass


class Stream:
    """Takes over `sock`, a connected non-blocking socket.

    `on_received(items)` gets the messages and runs of one read, in order; iterating may raise
    RemoteProtocolError, which is handed to `on_lost` where `on_received` lets it pass. `on_lost(error)` is
    called once when the connection ends for any reason but `close`; None means that the peer closed it. With
    `on_bytes(count)` in its place the owner learns how many bytes have come, and takes the items out of the
    session itself. Descriptors that come are given to the session where it `takes_descriptors`; else the
    kernel closes them. `taker`: for a side that can't trust the other.

    `may_read` and `may_write`, where they are given, are asked each time the event loop finds the socket
    readable or writable again. Where they say no, the stream waits for `read_on` or `write_on`.
    """

    def __init__(  # noqa: PLR0913
        self,
        sock: socket.socket,
        session: Session,
        outbox: Outbox,
        *,
        on_received: Callable[[Iterable[Any]], None] | None = None,
        on_lost: Callable[[Exception | None], None],
        on_bytes: Callable[[int], None] | None = None,
        takes_descriptors: bool = False,
        taker: Taker | None = None,
        may_read: Callable[[], bool] | None = None,
        may_write: Callable[[], bool] | None = None,
    ) -> None:
        self.session = session
        self.outbox = outbox
        self.is_closed = False
        self.is_blocked = False
        self.sent_bytes = 0
        self.has_ended = False
        """The other side sends no more, but the connection goes on (`linger`)."""
        self.is_unheard = False
        """The other side takes nothing any more; what it has sent may still be there to read."""
        self._does_linger = False
        self._holds = 0
        self._may_read = may_read
        self._may_write = may_write
        self._is_write_put_off = False
        self._is_finishing = False
        self._is_left = False  # nothing new will come, but there may be something to read: read to the end
        self._is_heard_out = False
        self._asked_bytes = 0  # of room in the kernel
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self.on_received = on_received or _ignore
        self._on_bytes = on_bytes
        self._on_lost = on_lost
        self._takes_descriptors = takes_descriptors
        self._taker = taker or _Trusting()
        self._rest: list[Buffer] = []
        self._rest_descriptors: tuple[Descriptor, ...] = ()
        self._before_write: Callable[[], None] | None = None
        self._loop.add_reader(sock.fileno(), self._on_readable)
        self._hang_ups = HangUps.of(self._loop)
        if self._hang_ups is not None:
            self._hang_ups.watch(sock.fileno(), self._hung_up)

    def before_write(self, action: Callable[[], None]) -> None:
        """Run `action` each time that the socket takes bytes again, before the next are chosen."""
        self._before_write = action

    def flush(self) -> int:
        """Send what waits, as far as the socket takes it and for a bounded time; the rest goes when it can.

        Returns how much work this was: one for each buffer, and one for each 4 KiB.
        """
        outbox, work = self.outbox, 0
        while (outbox.control or outbox.ready) and not self.is_blocked and not self.is_closed:
            if work >= _MOST_WORK:
                self._wait_to_write()
                break
            buffers, size, descriptors = outbox.take()
            if size:
                self._send(buffers, size, descriptors)
                work += len(buffers) + (size >> 12) + (_DESCRIPTORS_WORK if descriptors else 0)
        return work

    def hold(self) -> None:
        """Don't read until `release` was called as often: what the other side sends waits, and so does its
        end."""
        self._holds += 1
        if self._holds == 1 and not self.is_closed:
            self._loop.remove_reader(self._sock.fileno())

    def release(self) -> None:
        """Read again, if nothing else holds that up."""
        self._holds -= 1
        if not self._holds and not self.is_closed and not self.has_ended:
            self._loop.add_reader(self._sock.fileno(), self._on_readable)

    def write_on(self) -> None:
        """Write now, where `may_write` has put it off."""
        if self._is_write_put_off:
            self._is_write_put_off = False
            if self.is_blocked and not self.is_closed:
                self._loop.add_writer(self._sock.fileno(), self._on_writable)
                self._write()

    def read_on(self) -> bool:
        """Read once, whatever `may_read` says; returns whether there may be more to read."""
        return not self.is_closed and not self.has_ended and self._read()

    def fileno(self) -> int:
        """The number of the socket's descriptor."""
        return self._sock.fileno()

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be sent."""
        outbox = self.outbox
        return not (self.is_blocked or self.is_closed or outbox.ready or outbox.control)

    @property
    def is_quiet(self) -> bool:
        """Whether all that has come was read."""
        try:
            self._sock.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return True
        except OSError:
            pass
        return self.is_closed

    @property
    def has_hung_up(self) -> bool:
        """The other side has gone; what it sent before may still be there to read."""
        poll = select.poll()
        poll.register(self._sock, select.POLLRDHUP)
        return bool(poll.poll(0))

    def send_now(self, frames: Buffer, *, is_lent: bool = False) -> bool:
        """Send whole frames past the outbox, if nothing waits to be sent; returns whether it did.

        `is_lent`: they lie in a buffer that is soon used again, so what the socket does not take is copied.
        """
        outbox = self.outbox
        if self.is_blocked or self.is_closed or outbox.ready or outbox.control:
            return False
        try:
            sent = self._sock.send(frames)
        except OSError:
            self._send([bytes(frames) if is_lent else frames], len(frames))
            return not (self.is_unheard or self.is_closed)
        self.sent_bytes += sent
        if sent != len(frames):
            rest = memoryview(frames)[sent:]
            self._rest = [rest.tobytes() if is_lent else rest]
            self._be_full(len(frames))
        return True

    def finish(self) -> None:
        """End what has begun to be sent, send nothing after it, and go on reading."""
        self._is_finishing = True
        if not self._rest and not self.is_unheard and not self.is_closed:
            self._send_no_more()

    def linger(self) -> None:
        """From now on the other side may stop sending: that is no loss, it may still read what waits."""
        self._does_linger = True

    def hear_out(self) -> None:
        """Read only what has come by now: from here on the other side can't send."""
        with suppress(OSError):
            self._sock.shutdown(socket.SHUT_RD)
        self._is_left = self._is_heard_out = True
        self._loop.call_soon(self._read_rest)

    @property
    def is_drained(self) -> bool:
        """Whether nothing waits that could still be sent."""
        return self.is_closed or self.is_unheard or not (self.is_blocked or self.outbox)

    def close(self) -> None:
        """Send what the socket still takes and close it; what the socket does not take is lost."""
        while not (self.is_closed or self._rest or self.is_unheard) and self.outbox:
            self._send(*self.outbox.take())
        if not self.is_closed:
            self._close()

    def abandon(self) -> None:
        """In the child of a fork: let go of the socket, but leave alone the event loop, the parent's."""
        self.is_closed = True
        self._sock.close()
        if self._hang_ups is not None:
            self._hang_ups.abandon()
        self._drop_descriptors()

    def _on_readable(self) -> None:
        if self._may_read is None or self._may_read():
            self._read()

    def _on_writable(self) -> None:
        if self._may_write is None or self._may_write():
            self._write()
        else:
            self._is_write_put_off = True
            self._loop.remove_writer(self._sock.fileno())

    def _read(self) -> bool:
        """Take one buffer; returns whether there may be more."""
        try:
            buffer = self.session.reader.get_buffer()
            count = self._receive(buffer) if self._takes_descriptors else self._sock.recv_into(buffer)
            if len(buffer) > BUFFER_BYTES:
                keep_freed_memory()
            if count:
                if self._on_bytes is None:
                    self.on_received(self.session.received(count))
                else:
                    self._on_bytes(count)
                if self._is_left:
                    self._loop.call_soon(self._read_rest)
                return True
            if self._does_linger:
                self._loop.remove_reader(self._sock.fileno())
                self.has_ended = True
            else:
                self._lose(None)
        except (BlockingIOError, InterruptedError):
            pass
        except (OSError, RemoteProtocolError) as error:
            self._lose(error)
        return False

    def _receive(self, buffer: memoryview) -> int:
        """Bytes into the buffer, and a batch of descriptors, where one came with them, to the session."""
        count, ancillary, flags, _ = self._sock.recvmsg_into([buffer], self._taker.room, _CLOSE_ON_EXEC)
        if ancillary or flags & _CUT_OFF:
            numbers = _numbers(ancillary)
            # What was cut off is of no use in part. An empty batch keeps the place of the message's own.
            if flags & _CUT_OFF or len(numbers) > _MOST_DESCRIPTORS:
                self._taker.drop(numbers)
                if len(numbers) > _TOO_MANY_DESCRIPTORS:  # to drop them costs more than to send them
                    text = f"{len(numbers)} descriptors at once, a message brings {_MOST_DESCRIPTORS} at most"
                    self.session.reader.fault = RemoteProtocolError(text)
                numbers.clear()
            self.session.descriptors.append(tuple(map(self._taker.adopt, numbers)))
        return count

    def _send(self, buffers: list[Buffer], size: int, descriptors: tuple[Descriptor, ...] = ()) -> None:
        try:
            if descriptors:
                sent = self._sock.sendmsg(buffers, [_rights(descriptors)])
            elif len(buffers) == 1:
                sent = self._sock.send(buffers[0])
            elif size < _SHORT_BYTES:
                sent = self._sock.send(b"".join(buffers))  # cheaper than to describe them to sendmsg
            else:
                sent = self._sock.sendmsg(buffers)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except (BrokenPipeError, ConnectionResetError):
            self._be_quiet()
            return
        except OSError as error:
            if error.errno != errno.ETOOMANYREFS:
                self._lose(error)
                return
            self._rest, self._rest_descriptors = buffers, descriptors
            self._pause()
            return
        self.sent_bytes += sent
        if sent == size:
            return
        self._rest = _unsent(buffers, sent)
        self._rest_descriptors = () if sent else descriptors
        self._be_full(size)

    def _be_full(self, size: int) -> None:
        """The socket did not take all of `size` bytes: ask for more room, where much is sent at a time."""
        if size >= _LONG_BYTES:
            self._widen(_WIDE_BYTES if size < _HUGE_BYTES else _WIDEST_BYTES)
        self._wait_to_write()

    def _widen(self, wanted: int) -> None:
        if self._asked_bytes < wanted:
            self._asked_bytes = wanted
            with suppress(OSError):
                if self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) < 2 * wanted:
                    self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, wanted)

    def _wait_to_write(self) -> None:
        if not self.is_blocked:
            self.is_blocked = True
            self._loop.add_writer(self._sock.fileno(), self._on_writable)

    def _write(self) -> None:
        rest, self._rest = self._rest, []
        descriptors, self._rest_descriptors = self._rest_descriptors, ()
        if rest:
            self._send(rest, sum(map(len, rest)), descriptors)
        if self._rest or self.is_closed or self.is_unheard:
            return
        if self._is_finishing:
            self._send_no_more()
            return
        self.is_blocked = False
        self._loop.remove_writer(self._sock.fileno())
        if self._before_write is not None:
            self._before_write()
        self.flush()

    def _send_no_more(self) -> None:
        if self.is_blocked:
            self._loop.remove_writer(self._sock.fileno())
        self.is_blocked = self.is_unheard = True
        with suppress(OSError):
            self._sock.shutdown(socket.SHUT_WR)

    def _pause(self) -> None:
        """The user has as many descriptors in flight as the kernel allows; no event says when to go on."""
        if self.is_blocked:
            self._loop.remove_writer(self._sock.fileno())
        self.is_blocked = True
        self._loop.call_later(_RETRY_S, self._resume)

    def _resume(self) -> None:
        if not self.is_closed and not self.is_unheard:
            self._loop.add_writer(self._sock.fileno(), self._on_writable)

    def _be_quiet(self) -> None:
        """The other side has gone. What it sent before, and perhaps why it went, is still to be read."""
        self._send_no_more()
        self._is_left = True
        self._loop.call_soon(self._read_rest)

    def _hung_up(self) -> None:
        self._is_left = True
        self._read_rest()

    def _read_rest(self) -> None:
        # At once: the event loop may report the end only once (`HangUps`).
        if self.is_closed or self.has_ended:
            return
        may_read = self._may_read is None or self._may_read()  # asked first: it may release what holds
        if may_read and (not self._holds or self._is_heard_out):
            self._read()

    def _lose(self, error: Exception | None) -> None:
        if not self.is_closed:
            on_lost = self._on_lost
            self._close()
            on_lost(error)

    def _close(self) -> None:
        self.is_closed = True
        # Free what the callbacks hold now, not at the next garbage collection.
        self.on_received = self._on_lost = _ignore
        self._on_bytes = None
        self._before_write = None
        self._loop.remove_reader(self._sock.fileno())
        if self.is_blocked:
            self._loop.remove_writer(self._sock.fileno())
        if self._hang_ups is not None:
            self._hang_ups.forget(self._sock.fileno())
        # Nothing unread may be left: the other side's libuv would perhaps not see the end (`_read_rest`).
        self._taker.finish(self._sock)
        self._drop_descriptors()

    def _drop_descriptors(self) -> None:
        """Close those that came; those that were to go may have other owners."""
        self.session.drop_descriptors()
        self.session.reader.close()
        self.outbox.clear_control()
        self._rest_descriptors = ()


def _ignore(_: object) -> None:
    """Takes the place of the owner's callbacks after the end."""


def _unsent(buffers: list[Buffer], sent: int) -> list[Buffer]:
    for index, buffer in enumerate(buffers):
        if sent < len(buffer):
            return [memoryview(buffer)[sent:], *buffers[index + 1 :]]
        sent -= len(buffer)
    return []


def _rights(descriptors: tuple[Descriptor, ...]) -> tuple[int, int, bytes]:
    numbers = b"".join([_INT.pack(descriptor.fileno()) for descriptor in descriptors])
    return socket.SOL_SOCKET, socket.SCM_RIGHTS, numbers


def _numbers(ancillary: list[tuple[int, int, bytes]]) -> list[int]:
    """Of the descriptors that came."""
    return [
        number
        for level, kind, content in ancillary
        if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS
        for (number,) in _INT.iter_unpack(content[: len(content) // _INT.size * _INT.size])
    ]
