"""bus.transport.stream: the events of the socket that the loop watches in each state, and the calls on the
socket.
"""

import asyncio
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from bus.transport.hangups import HangUps
from bus.transport.stream import Handlers, Stream
from bus.transport.stream_state import ReadState, WriteState
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.outbox import Outbox
from bus.wire.session import Role, Session

HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION))
LONG = bytes(4 << 20)  # more than a socket takes at once
MANY = [HELLO] * 600  # more than is sent in one turn of the event loop, and less than a socket takes


class Loop:
    """Records the watched descriptors and the timers; runs nothing."""

    def __init__(self) -> None:
        self.readers: dict[int, Callable[[], Any]] = {}
        self.writers: dict[int, Callable[[], Any]] = {}
        self.timers: list[Callable[[], Any]] = []
        self.soon: list[Callable[[], Any]] = []

    def add_reader(self, number: int, callback: Any) -> None:
        self.readers[number] = callback

    def add_writer(self, number: int, callback: Any) -> None:
        self.writers[number] = callback

    def remove_reader(self, number: int) -> None:
        self.readers.pop(number, None)

    def remove_writer(self, number: int) -> None:
        self.writers.pop(number, None)

    def call_later(self, delay: float, callback: Any, *args: Any) -> None:
        self.timers.append(lambda: callback(*args))

    def call_soon(self, callback: Any, *args: Any) -> None:
        self.soon.append(lambda: callback(*args))


class Crowded:
    """A socket of a user with too many descriptors in flight, while `is_crowded` is true."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self.is_crowded = True

    def sendmsg(self, *args: Any) -> int:
        if self.is_crowded:
            raise OSError(109, "ETOOMANYREFS")
        return self._sock.sendmsg(*args)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sock, name)

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        self._sock.close()


class End:
    """One end of a connection, and the descriptors that its event loop watches."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.loop = Loop()
        monkeypatch.setattr(asyncio, "get_running_loop", lambda: self.loop)
        monkeypatch.setattr(HangUps, "of", lambda loop: None)
        self.mine, self.other = socket.socketpair()
        self.other.setblocking(False)
        self.mine.setblocking(False)
        self.number = self.mine.fileno()
        self.may_read = self.may_write = True
        self.items: list[object] = []
        self.losses: list[Exception | None] = []
        self.chosen = 0
        handlers = Handlers(
            on_received=self.items.extend,
            on_lost=self.losses.append,
            before_write=self.choose,
            may_read=lambda: self.may_read,
            may_write=lambda: self.may_write,
        )
        self.stream = Stream(self.mine, Session(Role.BROKER), Outbox(), handlers)
        self.check(ReadState.OPEN, WriteState.OPEN)

    def choose(self) -> None:
        self.chosen += 1

    def check(self, reading: ReadState, writing: WriteState, *, is_held: bool = False) -> None:
        assert (self.stream.reading, self.stream.writing) == (reading, writing)
        is_read = reading not in (ReadState.ENDED, ReadState.CLOSED) and not is_held
        assert (self.number in self.loop.readers) is is_read
        is_awaited = writing in (WriteState.BLOCKED, WriteState.FINISHING)
        assert (self.number in self.loop.writers) is is_awaited

    def say(self, *frames: bytes) -> None:
        for frame in frames:
            self.stream.outbox.put(frame)
        self.stream.flush()

    def block(self) -> None:
        self.say(LONG)
        self.check(ReadState.OPEN, WriteState.BLOCKED)

    def take(self) -> int:
        """Let the other side read everything. Returns the number of bytes; the end counts as -1."""
        count = 0
        while True:
            try:
                data = self.other.recv(1 << 20)
            except BlockingIOError:
                return count
            if not data:
                return -1 - count
            count += len(data)

    def read(self) -> None:
        self.loop.readers[self.number]()

    def write(self) -> None:
        self.loop.writers[self.number]()

    def run_soon(self) -> None:
        soon, self.loop.soon = self.loop.soon, []
        for call in soon:
            call()

    def close(self) -> None:
        if self.stream.reading is not ReadState.CLOSED:
            self.stream.close()
        self.check(ReadState.CLOSED, WriteState.CLOSED)
        self.other.close()
        self.mine.close()


@pytest.fixture
def end(monkeypatch: pytest.MonkeyPatch) -> Iterator[End]:
    end = End(monkeypatch)
    yield end
    end.close()


def test_blocked_until_the_socket_takes_the_rest(end: End) -> None:
    end.block()
    taken = end.take()
    while end.stream.writing is WriteState.BLOCKED:
        assert end.chosen == 0, "nothing new is chosen before the rest is sent"
        end.write()
        taken += end.take()
    assert taken == len(LONG)
    assert end.chosen == 1
    end.check(ReadState.OPEN, WriteState.OPEN)


def test_a_long_turn_goes_on_in_the_next(end: End) -> None:
    end.say(*MANY)
    end.check(ReadState.OPEN, WriteState.BLOCKED)
    assert not end.stream._rest
    end.write()
    end.check(ReadState.OPEN, WriteState.OPEN)
    assert end.take() == len(HELLO) * len(MANY)


def test_a_long_turn_that_is_the_last(end: End) -> None:
    end.say(*MANY)
    end.stream.finish()
    end.check(ReadState.OPEN, WriteState.ENDED)
    assert end.take() == -1 - end.stream.sent_bytes
    assert end.stream.outbox


@pytest.mark.parametrize("fits", [False, True])
def test_put_off_until_the_owner_writes_on(end: End, fits: bool) -> None:
    end.say(*(MANY if fits else [LONG]))
    end.stream.write_on()  # nothing was postponed
    end.check(ReadState.OPEN, WriteState.BLOCKED)
    end.may_write = False
    end.write()
    sent = end.stream.sent_bytes
    end.check(ReadState.OPEN, WriteState.DEFERRED)
    end.say(HELLO)
    end.check(ReadState.OPEN, WriteState.DEFERRED)
    assert end.stream.sent_bytes == sent
    end.take()
    end.stream.write_on()
    assert end.stream.sent_bytes > sent
    end.check(ReadState.OPEN, WriteState.OPEN if fits else WriteState.BLOCKED)
    assert end.chosen == fits


@pytest.mark.parametrize("is_put_off", [False, True])
def test_finishing_sends_what_has_begun_and_asks_nobody(end: End, is_put_off: bool) -> None:
    end.block()
    end.say(HELLO)
    end.may_write = False
    if is_put_off:
        end.write()
    end.stream.finish()
    end.stream.finish()
    end.check(ReadState.OPEN, WriteState.FINISHING)
    taken = end.take()
    while end.stream.writing is WriteState.FINISHING:
        end.write()
        more = end.take()
        taken += more if more >= 0 else -1 - more
    end.check(ReadState.OPEN, WriteState.ENDED)
    assert taken == len(LONG)
    assert end.chosen == 0
    assert end.stream.outbox, "what had not begun is still there"
    end.stream.finish()


@pytest.mark.parametrize("way", ["goes on", "finishes", "closes"])
def test_paused_for_a_moment(end: End, way: str) -> None:
    end.stream._sock = crowded = Crowded(end.mine)  # type: ignore[assignment]
    end.stream._send([HELLO], len(HELLO), (end.mine,))  # type: ignore[arg-type]
    end.check(ReadState.OPEN, WriteState.PAUSED)
    [retry] = end.loop.timers
    crowded.is_crowded = False
    match way:
        case "goes on":
            retry()
            end.check(ReadState.OPEN, WriteState.BLOCKED)
            end.write()
            end.check(ReadState.OPEN, WriteState.OPEN)
            assert end.take() == len(HELLO)
        case "finishes":
            end.stream.finish()
            end.check(ReadState.OPEN, WriteState.ENDED)
            assert end.take() == -1
            retry()
            end.check(ReadState.OPEN, WriteState.ENDED)
        case _:
            end.stream.close()
            retry()
            end.check(ReadState.CLOSED, WriteState.CLOSED)


def test_held_as_often_as_it_is_released(end: End) -> None:
    for is_held, change in [
        (True, end.stream.hold),
        (True, end.stream.hold),
        (True, end.stream.release),
        (False, end.stream.release),
    ]:
        change()
        end.check(ReadState.OPEN, WriteState.OPEN, is_held=is_held)
    assert not end.loop.soon


def test_read_only_where_the_owner_may(end: End) -> None:
    end.other.send(HELLO)
    end.may_read = False
    end.read()
    assert not end.items
    assert end.stream.read_on()
    assert len(end.items) == 1


def test_who_takes_nothing_is_still_read_to_the_end(end: End) -> None:
    end.other.send(HELLO)
    end.other.close()
    end.say(LONG)
    end.check(ReadState.HUNG_UP, WriteState.ENDED)
    end.run_soon()
    assert len(end.items) == 1
    end.check(ReadState.HUNG_UP, WriteState.ENDED)
    end.run_soon()
    assert end.losses == [None]
    end.check(ReadState.CLOSED, WriteState.CLOSED)


@pytest.mark.parametrize("does_linger", [False, True])
def test_held_by_the_owner_when_the_other_side_goes(end: End, does_linger: bool) -> None:
    if does_linger:
        end.stream.linger()
    end.other.send(HELLO)
    end.other.close()
    end.stream.hold()
    end.stream._hung_up()
    gone = ReadState.LINGERING_HUNG_UP if does_linger else ReadState.HUNG_UP
    end.check(gone, WriteState.OPEN, is_held=True)
    end.run_soon()
    assert not end.items
    end.stream.release()
    for _ in range(2):
        end.run_soon()
    assert len(end.items) == 1
    assert not end.stream.read_on()
    after = ReadState.ENDED if does_linger else ReadState.CLOSED
    end.check(after, WriteState.OPEN if does_linger else WriteState.CLOSED)
    assert end.losses == ([] if does_linger else [None])
    end.stream.linger()  # too late for an effect
    end.stream.drain_input()
    end.check(after, end.stream.writing)


def test_shut_by_the_owner_it_is_read_while_it_is_held(end: End) -> None:
    end.other.send(HELLO)
    end.stream.hold()
    end.stream.drain_input()
    end.check(ReadState.SHUT, WriteState.OPEN, is_held=True)
    end.may_read = False
    end.run_soon()
    assert not end.items
    end.may_read = True
    end.stream.hold()
    end.stream.release()
    for _ in range(2):
        end.run_soon()
    assert len(end.items) == 1
    end.check(ReadState.ENDED, WriteState.OPEN)
    assert end.losses == []
    assert end.stream.is_drained
