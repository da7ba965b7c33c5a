"""One UNIX stream socket on the event loop: reads into a Session, sends from an Outbox.

Uses the descriptor itself with add_reader and add_writer, because published samples must leave at once, not
at the end of the loop's turn. Must not know the meaning of messages.

A frame's descriptors go with its first byte, in a separate call (SCM_RIGHTS). The kernel ends a read with the
piece that carries descriptors, so one read brings at most one batch.

`bus.transport.stream_state` has the states of reading and writing.
"""

import asyncio
import errno
import select
import socket
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, Protocol

import msgspec

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.transport.hangups import HangUps
from bus.transport.memory import LARGE_BYTES, keep_freed_memory, room
from bus.transport.stream_state import (
    HUNG_UP,
    READ_OVER,
    READS,
    WRITE_OVER,
    WRITES,
    ReadEvent,
    ReadState,
    WriteEvent,
    WriteState,
    follow,
)
from bus.wire.framing import BUFFER_BYTES
from bus.wire.layout import DATA_HEAD_BYTES, RUN_BYTES
from bus.wire.outbox import Outbox
from bus.wire.runs import Buffer
from bus.wire.session import Session

_SHORT_BYTES = 4096
_LONG_BYTES, _WIDE_BYTES = 64 << 10, 208 << 10
_LONGEST_SHARED, _WIDEST_BYTES = DATA_HEAD_BYTES + RUN_BYTES, 1 << 20
"""Bytes sent at a time, and the socket buffer to request for them; a frame that is longer than any run of
several samples, and the buffer for that.

The kernel doubles the buffer, and reports room again when three quarters are free. By default a socket has
208 KiB, three long runs. The kernel allows at most twice that, or the administrator's limit
(net.core.wmem_max; 4 MiB on new kernels).

The widest buffer saves a third of the CPU time of messages of 64 KiB, because each turn of an event loop
moves up to 24 of them, not 4. Short messages don't get it: a slow subscription would find too many old ones
in it."""
_MOST_WORK = 512
"""Most work of one `flush`; the rest is sent in later turns of the loop."""
_DESCRIPTORS_WORK = 8
_RETRY_S = 0.05
_INT = struct.Struct("i")
_MOST_DESCRIPTORS = 2
"""Most descriptors of a message."""
_TOO_MANY_DESCRIPTORS = 16
_ANCILLARY_BYTES = socket.CMSG_SPACE(_MOST_DESCRIPTORS * _INT.size)
_CLOSE_ON_EXEC = int(getattr(socket, "MSG_CMSG_CLOEXEC", 0))  # Linux
_CUT_OFF = int(socket.MSG_CTRUNC)  # as an int: socket's enum of flags is ten times as slow
_WRITE_OPEN = WriteState.OPEN  # looked up for every message
_AWAITING = (WriteState.BLOCKED, WriteState.FINISHING)
"""The states in which the event loop watches whether the socket is writable."""


class Taker(Protocol):
    """Takes received descriptors."""

    room: int
    """Bytes for descriptors in one read; the kernel closes descriptors without room."""

    def adopt(self, number: int) -> Descriptor:
        """Own a descriptor that a message may claim."""

    def drop(self, numbers: Sequence[int]) -> None:
        """Close descriptors that no message can claim."""

    def finish(self, sock: socket.socket) -> None:
        """Read and discard the remaining data, and close the socket."""


class _Trusting:
    """A taker for a trusted peer."""

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


trusting: Taker = _Trusting()


def _ignore(*_: object) -> None:
    """Stands for missing handlers, and for all handlers after the end."""


def _always() -> bool:
    return True


class Handlers(msgspec.Struct, frozen=True, kw_only=True):
    """Functions of a stream's owner, which the stream calls."""

    on_lost: Callable[[Exception | None], None]
    """Called once when the connection ends, except by `close`. None: the other side closed it."""
    on_received: Callable[[Iterable[Any]], None] = _ignore
    """Gets the messages and runs of one read, in order.

    Iterating may raise RemoteProtocolError; if `on_received` does not catch it, the connection is lost."""
    on_bytes: Callable[[int], None] | None = None
    """Called instead of `on_received` with the number of new bytes, if the owner itself takes the items out
    of the session."""
    before_write: Callable[[], None] = _ignore
    """Called when the socket accepts bytes again, before the next bytes are chosen."""
    may_read: Callable[[], bool] = _always
    """Called when the event loop finds the socket readable. After False, the owner calls `read_on`."""
    may_write: Callable[[], bool] = _always
    """Called when the event loop finds the socket writable again. After False, the owner calls `write_on`."""


_NO_HANDLERS = Handlers(on_lost=_ignore)


class Stream:
    """Reads and writes `sock`, a connected non-blocking socket, which it owns from now on.

    `taker` gets the descriptors received with the bytes, and the session those that `taker` adopts. Without a
    taker, the kernel closes them.
    """

    def __init__(
        self,
        sock: socket.socket,
        session: Session,
        outbox: Outbox,
        handlers: Handlers,
        taker: Taker | None = None,
    ) -> None:
        self.session = session
        session.reader.make_room = room
        self.outbox = outbox
        self.reading = ReadState.OPEN
        self.writing = WriteState.OPEN
        """Owners only read `reading` and `writing`."""
        self.sent_bytes = 0
        self._holds = 0
        self._asked_bytes = 0  # requested socket buffer
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._handlers = handlers
        self._taker = taker
        self._rest: list[Buffer] = []  # empty while writing is OPEN
        self._rest_descriptors: tuple[Descriptor, ...] = ()
        self._watch_readable()
        self._hang_ups = HangUps.of(self._loop)
        if self._hang_ups is not None:
            self._hang_ups.watch(sock.fileno(), self._hung_up)

    def flush(self) -> int:
        """Send waiting data, as far as the socket accepts it and for a bounded time; the rest follows later.

        Returns the amount of work: one for each buffer, and one for each 4 KiB.
        """
        outbox, work = self.outbox, 0
        while (outbox.control or outbox.ready) and self.writing is _WRITE_OPEN:
            if work >= _MOST_WORK:
                self._change_writing(WriteEvent.BLOCK)
                break
            buffers, size, descriptors = outbox.take()
            if size:
                self._send(buffers, size, descriptors)
                work += len(buffers) + (size >> 12) + (_DESCRIPTORS_WORK if descriptors else 0)
        return work

    def hold(self) -> None:
        """Stop reading until `release` was called as often.

        Data of the other side, and its end, wait meanwhile.
        """
        self._holds += 1
        if self._holds == 1 and self.reading not in READ_OVER:
            self._loop.remove_reader(self._sock.fileno())

    def release(self) -> None:
        """Undo one `hold`; reads again if there is no other."""
        self._holds -= 1
        if not self._holds and self.reading not in READ_OVER:
            self._watch_readable()
        if self.reading in HUNG_UP:
            self._loop.call_soon(self._read_rest)

    def write_on(self) -> None:
        """Make the write that `may_write` has deferred."""
        if self.writing is WriteState.DEFERRED:
            self._write()

    def read_on(self) -> bool:
        """Read once, without regard to `may_read`; returns whether there may be more to read."""
        return self.reading not in READ_OVER and self._read()

    def fileno(self) -> int:
        """The number of the socket's descriptor."""
        return self._sock.fileno()

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be sent."""
        outbox = self.outbox
        return self.writing is _WRITE_OPEN and not (outbox.ready or outbox.control)

    @property
    def is_quiet(self) -> bool:
        """Whether all received data was read."""
        try:
            self._sock.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return True
        except OSError:
            pass
        return self.reading is ReadState.CLOSED

    @property
    def has_hung_up(self) -> bool:
        """Whether the other side has gone; its earlier data may still be unread."""
        poll = select.poll()
        poll.register(self._sock, select.POLLRDHUP)
        return bool(poll.poll(0))

    def send_now(self, frames: Buffer, *, is_lent: bool = False, number: int = 1) -> bool:
        """Send whole frames without the outbox, if no data waits; returns whether it did.

        `is_lent`: the frames lie in a buffer that is soon used again, so bytes that the socket does not
        accept are copied. `number`: of frames.
        """
        outbox = self.outbox
        if self.writing is not _WRITE_OPEN or outbox.ready or outbox.control:
            return False
        try:
            sent = self._sock.send(frames)
        except OSError:
            self._send([bytes(frames) if is_lent else frames], len(frames), longest=len(frames) // number)
            return self.writing not in WRITE_OVER
        self.sent_bytes += sent
        if sent != len(frames):
            rest = memoryview(frames)[sent:]
            self._rest = [rest.tobytes() if is_lent else rest]
            self._be_full(len(frames), len(frames) // number)
        return True

    def finish(self) -> None:
        """Send the rest of a frame that has begun, and nothing after it; continue to read."""
        self._change_writing(WriteEvent.FINISH if self._rest else WriteEvent.END)

    def linger(self) -> None:
        """Allow the other side to stop sending: that is no loss, because it may still read waiting data."""
        self._change_reading(ReadEvent.LINGER)

    def drain_input(self) -> None:
        """Read only data that has already come. From now on the other side can't send, which is no loss."""
        with suppress(OSError):
            self._sock.shutdown(socket.SHUT_RD)
        self._change_reading(ReadEvent.SHUT)
        self._loop.call_soon(self._read_rest)

    @property
    def is_drained(self) -> bool:
        """Whether no waiting data can still be sent."""
        return self.writing in WRITE_OVER or (self.writing is _WRITE_OPEN and not self.outbox)

    def close(self) -> None:
        """Send the data that the socket still accepts, and close it. The rest is lost."""
        while not self._rest and self.writing not in WRITE_OVER and self.outbox:
            self._send(*self.outbox.take())
        if self.reading is not ReadState.CLOSED:
            self._close()

    def abandon(self) -> None:
        """In the child of a fork: close the socket without touching the event loop, which is the parent's."""
        self.reading, self.writing = ReadState.CLOSED, WriteState.CLOSED
        self._sock.close()
        if self._hang_ups is not None:
            self._hang_ups.abandon()
        self._drop_descriptors()

    def _watch_readable(self) -> None:
        read = self._read if self._handlers.may_read is _always else self._on_readable
        self._loop.add_reader(self._sock.fileno(), read)

    def _on_readable(self) -> None:
        if self._handlers.may_read():
            self._read()

    def _on_writable(self) -> None:
        if self.writing is WriteState.FINISHING or self._handlers.may_write():
            self._write()
        else:
            self._change_writing(WriteEvent.DEFER)

    def _change_reading(self, event: ReadEvent) -> None:
        """Change the reading state, and do the work of the new one."""
        before = self.reading
        after = self.reading = follow(READS, before, event)
        if after is not before and after in READ_OVER:
            self._loop.remove_reader(self._sock.fileno())

    def _change_writing(self, event: WriteEvent) -> None:
        """Change the writing state, and do the work of the new one."""
        before = self.writing
        after = self.writing = follow(WRITES, before, event)
        if after is before:
            return
        if after in _AWAITING:
            self._loop.add_writer(self._sock.fileno(), self._on_writable)
        elif before in _AWAITING:
            self._loop.remove_writer(self._sock.fileno())
        if after is WriteState.PAUSED:
            self._loop.call_later(_RETRY_S, self._change_writing, WriteEvent.RETRY)
        elif after is WriteState.ENDED:
            with suppress(OSError):
                self._sock.shutdown(socket.SHUT_WR)

    def _read(self) -> bool:
        """Read one buffer; returns whether there may be more."""
        try:
            buffer = self.session.reader.get_buffer()
            taker = self._taker
            count = self._sock.recv_into(buffer) if taker is None else self._receive(buffer, taker)
            if count >= LARGE_BYTES:
                keep_freed_memory()
            if count:
                if (on_bytes := self._handlers.on_bytes) is None:
                    self._handlers.on_received(self.session.received(count))
                else:
                    on_bytes(count)
                return True
            if follow(READS, self.reading, ReadEvent.END) is ReadState.CLOSED:
                self._lose(None)
            else:
                self._change_reading(ReadEvent.END)
        except (BlockingIOError, InterruptedError):
            pass
        except (OSError, RemoteProtocolError) as error:
            self._lose(error)
        return False

    def _receive(self, buffer: memoryview, taker: Taker) -> int:
        """Receive bytes into the buffer, and pass a batch of descriptors, if there is one, to the session."""
        count, ancillary, flags, _ = self._sock.recvmsg_into([buffer], taker.room, _CLOSE_ON_EXEC)
        if ancillary or flags & _CUT_OFF:
            numbers = _numbers(ancillary)
            # A truncated batch is useless. An empty batch takes its place for the message.
            if flags & _CUT_OFF or len(numbers) > _MOST_DESCRIPTORS:
                taker.drop(numbers)
                if len(numbers) > _TOO_MANY_DESCRIPTORS:  # dropping them costs more than sending them
                    text = f"{len(numbers)} descriptors at once, a message brings {_MOST_DESCRIPTORS} at most"
                    self.session.reader.fault = RemoteProtocolError(text)
                numbers.clear()
            self.session.descriptors.append(tuple(map(taker.adopt, numbers)))
        return count

    def _send(
        self, buffers: list[Buffer], size: int, descriptors: tuple[Descriptor, ...] = (), longest: int = 0
    ) -> None:
        try:
            if descriptors:
                sent = self._sock.sendmsg(buffers, [_rights(descriptors)])
            elif len(buffers) == 1:
                sent = self._sock.send(buffers[0])
            elif size < _SHORT_BYTES:
                sent = self._sock.send(b"".join(buffers))  # cheaper than a list of buffers for sendmsg
            else:
                sent = self._sock.sendmsg(buffers)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except (BrokenPipeError, ConnectionResetError):
            # The other side has gone. Its earlier data, perhaps with the reason, must still be read.
            self._change_writing(WriteEvent.END)
            self._change_reading(ReadEvent.HANG_UP)
            self._loop.call_soon(self._read_rest)
            return
        except OSError as error:
            if error.errno != errno.ETOOMANYREFS:
                self._lose(error)
                return
            self._rest, self._rest_descriptors = buffers, descriptors
            self._change_writing(WriteEvent.PAUSE)
            return
        self.sent_bytes += sent
        if sent == size:
            return
        self._rest = _unsent(buffers, sent)
        self._rest_descriptors = () if sent else descriptors
        self._be_full(size, longest or DATA_HEAD_BYTES + max(map(len, buffers)))

    def _be_full(self, size: int, longest: int) -> None:
        """Request a larger socket buffer, if the socket did not accept all of `size` bytes and these are
        many. `longest`: bytes of the longest frame."""
        if size >= _LONG_BYTES:
            self._widen(_WIDE_BYTES if longest <= _LONGEST_SHARED else _WIDEST_BYTES)
        self._change_writing(WriteEvent.BLOCK)

    def _widen(self, wanted: int) -> None:
        if self._asked_bytes < wanted:
            self._asked_bytes = wanted
            with suppress(OSError):
                if self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF) < 2 * wanted:
                    self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, wanted)

    def _write(self) -> None:
        rest, self._rest = self._rest, []
        descriptors, self._rest_descriptors = self._rest_descriptors, ()
        if rest:
            self._send(rest, sum(map(len, rest)), descriptors)
        if self._rest or self.writing in WRITE_OVER:
            return
        self._change_writing(WriteEvent.DRAIN)
        if self.writing is _WRITE_OPEN:
            self._handlers.before_write()
            self.flush()

    def _hung_up(self) -> None:
        self._change_reading(ReadEvent.HANG_UP)
        self._read_rest()

    def _read_rest(self) -> None:
        # At once: the event loop may report the end only once (`HangUps`).
        if self.reading in READ_OVER:
            return
        may_read = self._handlers.may_read()  # called first: it may undo a hold
        if may_read and (not self._holds or self.reading is ReadState.SHUT) and self._read():
            self._loop.call_soon(self._read_rest)

    def _lose(self, error: Exception | None) -> None:
        if self.reading is not ReadState.CLOSED:
            on_lost = self._handlers.on_lost
            self._close()
            on_lost(error)

    def _close(self) -> None:
        self._handlers = _NO_HANDLERS  # free their references now, not at the next garbage collection
        self._change_reading(ReadEvent.CLOSE)
        self._change_writing(WriteEvent.CLOSE)
        if self._hang_ups is not None:
            self._hang_ups.forget(self._sock.fileno())
        # No bytes may stay unread: otherwise the other side's libuv might not see the end (`_read_rest`).
        (self._taker or trusting).finish(self._sock)
        self._drop_descriptors()

    def _drop_descriptors(self) -> None:
        """Close received descriptors; descriptors to be sent may have other owners."""
        self.session.drop_descriptors()
        self.session.reader.close()
        self.outbox.clear_control()
        self._rest_descriptors = ()


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
    """The numbers of received descriptors."""
    return [
        number
        for level, kind, content in ancillary
        if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS
        for (number,) in _INT.iter_unpack(content[: len(content) // _INT.size * _INT.size])
    ]
