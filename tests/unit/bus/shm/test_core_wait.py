"""bus.shm._core: Reader.wait, which sleeps in place of an event loop, and returns with a message."""

import gc
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import partial
from typing import Any

import pytest

from bus.shm import segments
from conftest import WAIT_S
from shm_ends import Listener, Talker, core, is_rung, listener, talker

__all__ = ["listener", "talker"]

LONG_S = 10.0
"""A wait for this time ends long before it if the test passes."""


class Waiting:
    """A reader that may wait, and an event loop's epoll with its doorbell."""

    def __init__(self, listener: Listener, talker: Talker) -> None:
        self.listener, self.talker = listener, talker
        self.epoll = select.epoll()
        self.epoll.register(listener.doorbell.number, select.EPOLLIN)
        listener.join(talker)
        listener.readers.sleep()
        listener.reader.is_report_due = True
        talker.writer.is_mine = lambda: True

    def wait(
        self, time_s: float = 0.005, due_s: float = 0.0, decode: Any = bytes, has_origin: bool = False
    ) -> Any:
        deadline_ns = time.monotonic_ns() + round(time_s * 1e9)
        reader = self.listener.reader
        return reader.wait(decode, has_origin, self.epoll.fileno(), deadline_ns, due_s)

    def wait_quickly(self, **options: Any) -> Any:
        """Like `wait`, but a message or another event must end it, not the time."""
        assert self.wait(0) is None  # the loop's turn; the next one is due later
        begin = time.monotonic()
        found = self.wait(LONG_S, **options)
        assert time.monotonic() - begin < LONG_S / 2
        return found


@pytest.fixture
def waiting(listener: Listener, talker: Talker) -> Iterator[Waiting]:
    one = Waiting(listener, talker)
    yield one
    one.epoll.close()


def soon(act: Callable[[], object]) -> threading.Timer:
    timer = threading.Timer(0.02, act)
    timer.start()
    return timer


def another(listener: Listener, talker: Talker, owner: object) -> Any:
    """Another reader of the same process."""
    reader = core.Reader(listener.readers, owner, 0, tells_cursor=False)
    reader.attach(1, segments.map_ring(talker.ring), next(listener.slots))
    return reader


def test_what_is_there_is_taken_without_a_sleep(waiting: Waiting) -> None:
    waiting.talker.write(b"one", b"", b"three")
    assert [waiting.wait_quickly() for _ in range(3)] == [b"one", b"", b"three"]
    assert waiting.listener.reader.samples == 3


@pytest.mark.parametrize("is_rung_before", [False, True])
def test_it_sleeps_until_a_message_comes(waiting: Waiting, is_rung_before: bool) -> None:
    """The same is true if the doorbell rang for messages that are already taken."""
    for number in range(5):
        if is_rung_before:
            waiting.talker.write(b"before")
            assert waiting.wait_quickly() == b"before"
        timer = soon(partial(waiting.talker.write, b"%d" % number))
        assert waiting.wait_quickly() == b"%d" % number
        timer.join()


def test_a_message_comes_first_and_its_ring_is_heard_before_the_next_sleep(waiting: Waiting) -> None:
    rung, end = 0, time.monotonic() + WAIT_S
    while rung < 3:  # on a busy machine, some messages come before the reader sleeps
        assert time.monotonic() < end
        timer = soon(lambda: waiting.talker.write(b"x"))
        assert waiting.wait_quickly() == b"x"
        timer.join()
        before, rung = rung, waiting.talker.writer._debug()["rung"]
        assert rung <= before + 1
    assert rung > before
    assert is_rung(waiting.listener.doorbell)  # a loop would notice it, and then sleep
    assert waiting.wait(0) is None
    assert waiting.wait(0.01) is None
    assert not is_rung(waiting.listener.doorbell)
    waiting.talker.write(b"y")
    assert is_rung(waiting.listener.doorbell)  # the wait ended in sleep


def test_where_the_message_came_from(waiting: Waiting) -> None:
    waiting.talker.write(b"x")
    message, stamp_ns, seq, source, received_ns = waiting.wait_quickly(has_origin=True)
    assert (message, seq, source) == (b"x", 1, 1)
    assert stamp_ns <= received_ns <= time.monotonic_ns()


@pytest.mark.parametrize("time_s", [0.0, 0.003, 0.0305, 0.05])
@pytest.mark.parametrize("is_due", [False, True])
def test_the_time_is_over(waiting: Waiting, time_s: float, is_due: bool) -> None:
    assert waiting.wait(0) is None
    begin = time.monotonic()
    if is_due:
        assert waiting.wait(LONG_S, due_s=begin + time_s) is None
    else:
        assert waiting.wait(time_s) is None
    assert time_s - 1e-6 <= time.monotonic() - begin < LONG_S / 2


def test_no_time_at_all(waiting: Waiting) -> None:
    assert waiting.wait(0) is None
    timer = soon(lambda: waiting.talker.write(b"x"))
    assert waiting.listener.reader.wait(bytes, False, waiting.epoll.fileno(), 0, 0.0) == b"x"
    timer.join()


def test_other_events_are_the_loops(waiting: Waiting) -> None:
    reads, writes = os.pipe()
    waiting.epoll.register(reads, select.EPOLLIN)
    timer = soon(lambda: os.write(writes, b"x"))
    assert waiting.wait_quickly() is None
    timer.join()

    waiting.talker.write(b"first")
    assert waiting.wait_quickly() == b"first"
    assert waiting.wait_quickly() is None
    os.close(reads)
    os.close(writes)


def test_the_loop_has_its_turn_now_and_then(waiting: Waiting) -> None:
    end = time.monotonic() + 0.1
    found = []
    while time.monotonic() < end:
        waiting.talker.write(b"x")
        found.append(waiting.wait(LONG_S))
    assert 0 < found.count(None) <= 30
    assert found.count(b"x") > found.count(None)


def test_news_of_another_reader_are_told_by_the_doorbell(waiting: Waiting) -> None:
    talker = Talker()
    talker.writer.is_mine = lambda: True
    other = another(waiting.listener, talker, "other")
    talker.writer.add_gate(1, waiting.listener.bell, 1, is_lossless=False)
    waiting.listener.readers.sleep()
    timer = soon(lambda: talker.write(b"x"))
    assert waiting.wait_quickly() is None
    timer.join()
    assert waiting.wait_quickly() is None  # until the other reader is served
    assert is_rung(waiting.listener.doorbell)
    assert waiting.listener.readers.deliver(False) == ["other"]
    assert other.messages(1, bytes) == [b"x"]
    talker.close()


def test_news_of_another_reader_that_were_not_rung_for(waiting: Waiting) -> None:
    """The message was published while the process was awake, so no doorbell rang. The look before the sleep
    finds it.
    """
    talker = Talker()
    other = another(waiting.listener, talker, "other")
    waiting.listener.readers.deliver(False)
    talker.write(b"x")
    assert waiting.wait_quickly() is None
    assert is_rung(waiting.listener.doorbell)
    assert waiting.listener.readers.deliver(False) == ["other"]
    assert other.waiting() == 1
    talker.close()


@pytest.mark.parametrize("why", ["closed", "writers", "not noted", "detached"])
def test_where_it_must_not_wait(waiting: Waiting, why: str) -> None:
    readers, reader = waiting.listener.readers, waiting.listener.reader
    waiting.talker.write(b"x")
    match why:
        case "closed":
            readers.close()
        case "writers":
            readers.has_writers = True
        case "not noted":
            reader.is_report_due = False
        case "detached":
            reader.detach(1)
    assert waiting.wait_quickly() is None
    assert reader.samples == 0


def test_closed_while_it_sleeps(waiting: Waiting) -> None:
    def close() -> None:
        waiting.listener.readers.close()
        os.eventfd_write(waiting.listener.doorbell.number, 1)

    timer = soon(close)
    assert waiting.wait_quickly() is None
    timer.join()


def test_a_message_that_is_refused_is_looked_after(waiting: Waiting) -> None:
    def decode(payload: bytes) -> bytes:
        if payload == b"bad":
            raise ValueError("bad")
        return bytes(payload)

    waiting.talker.write(b"bad", b"good")
    assert waiting.wait_quickly(decode=decode) is None
    assert waiting.wait_quickly(decode=decode) is None
    ((size, error),) = waiting.listener.reader.pop_rejected()
    assert (size, str(error)) == (3, "bad")
    assert waiting.wait_quickly(decode=decode) == b"good"


def test_an_exception_that_is_none_comes_out(waiting: Waiting) -> None:
    def decode(payload: bytes) -> bytes:
        raise SystemExit(3)

    waiting.talker.write(b"x", b"y")
    with pytest.raises(SystemExit):
        waiting.wait_quickly(decode=decode)
    assert waiting.wait_quickly() == b"y"


def test_a_decoder_that_closes_it_all(waiting: Waiting) -> None:
    def decode(payload: bytes) -> bytes:
        waiting.listener.reader.detach(1)
        waiting.listener.readers.close()
        return bytes(payload)

    waiting.talker.write(b"x", b"y")
    assert waiting.wait_quickly(decode=decode) == b"x"
    assert waiting.wait_quickly() is None


@pytest.mark.parametrize("raises", [False, True])
def test_a_signals_handler_is_called_at_once(waiting: Waiting, raises: bool) -> None:
    """The signal is repeated, because the first one may come before the wait begins."""
    called = []

    def handle(number: int, frame: object) -> None:
        called.append(number)
        if raises and len(called) == 1:
            raise LookupError("by the handler")

    main, is_over = threading.get_ident(), threading.Event()

    def send() -> None:
        while not is_over.wait(0.02):
            signal.pthread_kill(main, signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, handle)
    sender = threading.Thread(target=send)
    try:
        with pytest.raises(LookupError, match="by the handler") if raises else nullcontext():
            sender.start()
            assert waiting.wait_quickly() is None
    finally:
        is_over.set()
        sender.join()
        signal.signal(signal.SIGUSR1, before)
    assert set(called) == {signal.SIGUSR1}
    waiting.talker.write(b"x")
    assert waiting.wait_quickly() == b"x"


def test_wrong_arguments(waiting: Waiting) -> None:
    reader = waiting.listener.reader
    for arguments in (
        (),
        (bytes, False, "epoll", 0, 0.0),
        (bytes, False, 0, -1, 0.0),
        (bytes, False, 0, 0, "soon"),
    ):
        with pytest.raises((TypeError, OverflowError, ValueError)):
            reader.wait(*arguments)
    assert waiting.wait(0) is None
    assert reader.wait(bytes, False, 1 << 20, 0, 0.0) is None  # the loop will report the error


def test_nothing_is_left_behind(waiting: Waiting) -> None:
    message = bytes
    counts = sys.getrefcount(message), len(gc.get_objects())
    for _ in range(20_000):
        waiting.talker.write(b"x" * 64)
        while waiting.wait_quickly(decode=message) is None:
            pass
    assert abs(sys.getrefcount(message) - counts[0]) < 50
    gc.collect()
    assert len(gc.get_objects()) - counts[1] < 50
