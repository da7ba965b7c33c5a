"""The loop that threads share: its guard, wake-ups, deadlines, interrupts, and four threads at once."""

import asyncio
import random
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import pytest

from bus.process.shared_loop import GuardedLoop
from conftest import WAIT_S
from neighbours import wait_until

SECOND_NS = 10**9


@pytest.fixture
def loop() -> Iterator[GuardedLoop]:
    loop = GuardedLoop()
    yield loop
    loop.close()


@contextmanager
def running(loop: GuardedLoop) -> Iterator[None]:
    """Run the loop in another thread."""

    def run() -> None:
        with loop:
            loop.run()

    thread = threading.Thread(target=run, name="runner")
    thread.start()
    try:
        wait_until(lambda: loop.is_waiting)
        yield
    finally:
        with loop:
            loop.stop()
        thread.join(WAIT_S)
    assert not thread.is_alive()


class TestGuard:
    def test_it_belongs_to_one_thread(self, loop: GuardedLoop) -> None:
        seen: list[bool] = []
        assert not loop.is_mine()
        with loop:
            assert loop.is_mine()
            other = threading.Thread(target=lambda: seen.append(loop.is_mine()))
            other.start()
            other.join()
        assert seen == [False] and not loop.is_mine()

    def test_an_error_gives_it_away(self, loop: GuardedLoop) -> None:
        with pytest.raises(LookupError), loop:
            raise LookupError
        assert not loop.is_mine()
        with loop:
            pass

    def test_who_runs_the_loop_has_it_but_while_it_waits(self, loop: GuardedLoop) -> None:
        seen: list[bool] = []
        with running(loop):
            with loop:
                loop.call_soon(lambda: seen.append(loop.is_mine()))
            wait_until(lambda: seen)
        assert seen == [True]

    def test_who_wants_it_gets_it_from_a_busy_loop(self, loop: GuardedLoop) -> None:
        """Each callback schedules the next one, so the loop never rests."""
        turns = [0]

        def again() -> None:
            turns[0] += 1
            loop.call_soon(again)

        with running(loop):
            with loop:
                loop.call_soon(again)
            for _ in range(20):
                with loop:
                    before = turns[0]
                wait_until(lambda before=before: turns[0] > before)


class TestWhatWakesIt:
    @pytest.mark.parametrize(
        "ask",
        [
            lambda loop, told: loop.call_soon(told.append, 1),
            lambda loop, told: loop.call_later(0.001, told.append, 1),
            lambda loop, told: loop.call_at(loop.time() - 1, told.append, 1),
            lambda loop, told: loop.create_task(asyncio.sleep(0)).add_done_callback(told.append),
        ],
        ids=["call_soon", "call_later", "call_at", "task"],
    )
    def test_calls_of_another_thread(
        self, loop: GuardedLoop, ask: Callable[[GuardedLoop, list[Any]], object]
    ) -> None:
        told: list[Any] = []
        with running(loop):
            with loop:
                ask(loop, told)
            wait_until(lambda: told)

    def test_calls_without_the_guard(self, loop: GuardedLoop) -> None:
        told: list[int] = []
        with running(loop):
            loop.call_soon_threadsafe(told.append, 1)
            wait_until(lambda: told)

    def test_descriptors(self, loop: GuardedLoop) -> None:
        near, far = socket.socketpair()
        heard: list[bytes] = []
        with near, far, running(loop):
            with loop:
                loop.add_reader(near, lambda: heard.append(near.recv(10)))
            far.send(b"one")
            wait_until(lambda: heard)
            written: list[int] = []
            with loop:

                def write() -> None:
                    written.append(near.send(b"two"))
                    loop.remove_writer(near)

                loop.add_writer(near, write)
            wait_until(lambda: written)
            assert far.recv(10) == b"two"
            with loop:
                loop.remove_reader(near)
        assert heard == [b"one"]

    def test_a_reader_that_raises_is_reported_and_the_loop_goes_on(self, loop: GuardedLoop) -> None:
        near, far = socket.socketpair()
        errors: list[Any] = []
        told: list[int] = []

        def fail() -> None:
            near.recv(10)
            raise LookupError("in a reader")

        loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
        with near, far, running(loop):
            with loop:
                loop.add_reader(near, fail)
            far.send(b"x")
            wait_until(lambda: errors)
            with loop:
                loop.call_soon(told.append, 1)
                loop.remove_reader(near)
            wait_until(lambda: told)
        assert [str(error) for error in errors] == ["in a reader"]


class TestRunning:
    def test_in_the_order_of_asyncio(self, loop: GuardedLoop) -> None:
        told: list[str] = []
        with loop:
            now = loop.time()
            loop.call_at(now + 0.002, told.append, "later")
            loop.call_at(now + 0.001, told.append, "sooner")
            loop.call_soon(told.append, "first")
            loop.call_soon(told.append, "second")
            loop.call_at(now + 0.003, loop.stop)
            loop.run()
        assert told == ["first", "second", "sooner", "later"]

    def test_until_a_deadline(self, loop: GuardedLoop) -> None:
        told: list[int] = []
        begin = time.monotonic_ns()
        with loop:
            loop.call_later(3600, told.append, 1)
            loop.run(deadline_ns=begin + SECOND_NS // 50)
        assert time.monotonic_ns() - begin >= SECOND_NS // 50
        with loop:
            loop.call_soon(told.append, 2)
            loop.run(deadline_ns=begin)
        assert told == [2], "a turn in any case"

    def test_until_something_is_set(self, loop: GuardedLoop) -> None:
        class Flag:
            is_set = False

        flag = Flag()
        with loop:
            loop.call_later(0.001, setattr, flag, "is_set", True)
            loop.run(flag)
        assert flag.is_set

    def test_again_and_by_other_threads(self, loop: GuardedLoop) -> None:
        told: list[int] = []

        def once() -> None:
            with loop:
                loop.call_soon(told.append, threading.get_ident())
                loop.call_soon(loop.stop)
                loop.run()

        threads = [threading.Thread(target=once) for _ in range(3)]
        for thread in threads:
            thread.start()
            thread.join(WAIT_S)
        once()
        assert len(set(told)) >= 2 and len(told) == 4

    def test_it_is_the_running_loop_of_its_callbacks_only(self, loop: GuardedLoop) -> None:
        seen: list[Any] = []
        with loop:
            loop.call_soon(lambda: seen.append(asyncio.get_running_loop()))
            loop.call_soon(loop.stop)
            loop.run()
        assert seen == [loop]
        with pytest.raises(RuntimeError):
            asyncio.get_running_loop()

    def test_what_is_deferred_comes_with_the_next_run(self, loop: GuardedLoop) -> None:
        told: list[int] = []
        with loop:
            loop.deferred.append((told.append, (1,)))
            assert not loop.is_due and told == []
            loop.call_soon(loop.stop)
            assert loop.is_due
            loop.run()
            assert told == [1] and not loop.is_due

    def test_many_cancelled_timers(self, loop: GuardedLoop) -> None:
        told: list[int] = []
        with loop:
            for _ in range(500):
                loop.call_later(3600, told.append, 0).cancel()
            loop.call_later(0.001, told.append, 1)
            loop.call_later(0.002, loop.stop)
            loop.run()
        assert told == [1]
        assert len(loop._scheduled) == 0

    def test_a_callback_that_raises_is_reported(self, loop: GuardedLoop) -> None:
        errors: list[Any] = []
        loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
        with loop:
            loop.call_soon(lambda: 1 // 0)
            loop.call_soon(loop.stop)
            loop.run()
        assert [type(error) for error in errors] == [ZeroDivisionError]


class TestInterrupts:
    def test_the_main_thread_raises_where_the_guard_ends(self, loop: GuardedLoop) -> None:
        done: list[str] = []
        with pytest.raises(KeyboardInterrupt), loop:
            loop.is_interrupted = True
            done.append("all of it")
        assert done == ["all of it"] and not loop.is_interrupted and not loop.is_mine()
        with loop:
            pass

    def test_other_threads_don_t(self, loop: GuardedLoop) -> None:
        ended: list[int] = []

        def use() -> None:
            with loop:
                ended.append(1)

        loop.is_interrupted = True
        thread = threading.Thread(target=use)
        thread.start()
        thread.join(WAIT_S)
        assert ended == [1] and loop.is_interrupted
        with pytest.raises(KeyboardInterrupt):
            loop.check()
        loop.check()

    def test_a_run_ends(self, loop: GuardedLoop) -> None:
        """A signal handler that finds the loop busy ends the run. The test does this 30 times, at any
        moment.
        """
        main = threading.main_thread().ident
        assert main is not None
        handled: list[bool] = []

        def handler(number: int, frame: FrameType | None) -> None:
            handled.append(loop.is_busy(frame))
            loop.is_interrupted = True
            loop.interrupt()

        before = signal.signal(signal.SIGUSR1, handler)
        delays = random.Random(5)
        loop.wake_on_signals()
        try:
            for _ in range(30):
                timer = threading.Timer(delays.random() * 0.005, signal.pthread_kill, (main, signal.SIGUSR1))
                timer.start()
                with pytest.raises(KeyboardInterrupt), loop:
                    while not loop.is_interrupted:
                        loop.run()
                timer.join()
                assert not loop.is_mine()
        finally:
            signal.signal(signal.SIGUSR1, before)
        assert len(handled) == 30


def test_four_threads_for_half_a_second(loop: GuardedLoop) -> None:
    """One thread runs the loop. Three ask it for random calls, and the loop makes all of them, one at a
    time.
    """
    told: list[tuple[int, int]] = []
    expected: list[list[int]] = [[], [], []]
    shared = [0]
    end = time.monotonic() + 0.5
    errors: list[BaseException] = []

    def touch() -> None:
        """Without the guard, updates would get lost."""
        value = shared[0]
        time.sleep(0)
        shared[0] = value + 1

    def note(thread: int, number: int) -> None:
        touch()
        told.append((thread, number))

    def ask(thread: int) -> None:
        choose, number = random.Random(thread), 0
        try:
            while time.monotonic() < end:
                with loop:
                    touch()
                    what = choose.randrange(5)
                    if what == 0:
                        loop.call_soon(note, thread, number)
                    elif what == 1:
                        loop.call_later(choose.random() * 0.003, note, thread, number)
                    elif what == 2:
                        loop.call_later(choose.random() * 0.003, note, thread, -1).cancel()
                    elif what == 3:
                        loop.deferred.append((note, (thread, number)))
                        loop.wake()
                    else:
                        task = loop.create_task(asyncio.sleep(0))
                        task.add_done_callback(lambda _, number=number: note(thread, number))
                if what != 2:
                    expected[thread].append(number)
                    number += 1
                touches[thread] += 1
                if choose.random() < 0.2:
                    time.sleep(choose.random() * 0.002)
        except BaseException as error:
            errors.append(error)

    touches = [0, 0, 0]
    with running(loop):
        threads = [threading.Thread(target=ask, args=(index,)) for index in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(WAIT_S)
        assert errors == []
        with loop:
            loop.call_later(0.02, loop.wake)
        wait_until(lambda: len(told) == sum(map(len, expected)))
    for index, numbers in enumerate(expected):
        assert sorted(number for who, number in told if who == index) == numbers
    assert shared[0] == sum(touches) + len(told)


class TestLooks:
    def test_it_has_events_where_a_run_would_find_something_to_do(self, loop: GuardedLoop) -> None:
        loop.acquire()
        loop.run(deadline_ns=1)
        assert not loop.has_events()
        loop.call_soon(int)
        assert loop.has_events()
        loop.run(deadline_ns=1)
        assert not loop.has_events()
        loop.call_later(0, int)
        assert loop.has_events()
        loop.run(deadline_ns=1)
        one, other = socket.socketpair()
        with one, other:
            loop.add_reader(one, one.recv, 1)
            assert not loop.has_events()
            other.send(b"x")
            assert loop.has_events()
            loop.run(deadline_ns=1)
            assert not loop.has_events()
            loop.remove_reader(one)
        loop.release()

    def test_what_is_looked_for_comes_before_the_events_which_stay(self, loop: GuardedLoop) -> None:
        one, other = socket.socketpair()
        said: list[str] = []
        with one, other, loop:
            loop.add_reader(one, lambda: said.append(one.recv(1).decode()))
            other.send(b"x")
            assert loop.run(look=lambda: "found") == "found"
            assert said == []
            assert loop.run(deadline_ns=1, look=lambda: "") is None
            assert said == ["x"]
            loop.remove_reader(one)
