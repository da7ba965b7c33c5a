"""The engine of the facade: the thread that runs the loop, waiting in many threads, interrupts."""

import asyncio
import gc
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType
from typing import Any

import pytest

from bus_ros import engine as engines
from bus_ros.engine import Engine, Waiter
from bus_ros.rclpy.context import Context
from conftest import WAIT_S
from neighbours import wait_until

LONG_S = 3600


@pytest.fixture
def engine() -> Iterator[Engine]:
    before = set(threading.enumerate())
    engine = Engine()
    yield engine
    engine.close()
    assert set(threading.enumerate()) <= before


def in_threads(count: int, function: Callable[[int], object]) -> None:
    """Run `function(index)` in `count` threads at once. Raises an error of one of them."""
    errors: list[BaseException] = []

    def run(index: int) -> None:
        try:
            function(index)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run, args=(index,)) for index in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT_S)
    assert not any(thread.is_alive() for thread in threads)
    if errors:
        raise errors[0]


async def doubled(number: int, delay_s: float = 0) -> int:
    await asyncio.sleep(delay_s)
    return 2 * number


class TestRun:
    def test_a_result(self, engine: Engine) -> None:
        assert engine.run(lambda: doubled(3)) == 6
        assert engine.run(lambda: doubled(3, 0.001), timeout_s=WAIT_S) == 6

    def test_an_error(self, engine: Engine) -> None:
        async def fail() -> None:
            raise LookupError("inside")

        with pytest.raises(LookupError, match="inside"):
            engine.run(fail)

    def test_a_timeout_cancels_it(self, engine: Engine) -> None:
        begun: list[bool] = []
        ended: list[str] = []

        async def wait() -> None:
            begun.append(True)
            try:
                await asyncio.sleep(LONG_S)
            except asyncio.CancelledError:
                ended.append("cancelled")
                raise

        while not begun:  # on a busy machine, it may be cancelled before it begins
            with pytest.raises(TimeoutError):
                engine.run(wait, timeout_s=0.02)
        wait_until(lambda: ended)
        assert ended == ["cancelled"]

    def test_a_timeout_of_nothing_gives_it_a_turn(self, engine: Engine) -> None:
        async def at_once() -> int:
            return 1

        assert engine.run(at_once, timeout_s=0) == 1

    def test_the_end_of_a_context_ends_it(self, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(engines, "_engine", engine)
        context = Context()
        context.init([])
        timer = threading.Timer(0.02, context.shutdown)
        timer.start()
        with pytest.raises(TimeoutError):
            engine.run(lambda: asyncio.sleep(LONG_S), context=context)
        with pytest.raises(TimeoutError):
            engine.run(lambda: asyncio.sleep(LONG_S), context=context)
        timer.join()

    def test_many_threads_at_once(self, engine: Engine) -> None:
        results: dict[int, list[int]] = {}

        def use(thread: int) -> None:
            choose = random.Random(thread)
            results[thread] = [
                engine.run(partial(doubled, number, choose.choice((0, 0.0005, 0.002))))
                for number in range(50)
            ]

        in_threads(8, use)
        assert results == {thread: [2 * number for number in range(50)] for thread in range(8)}

    def test_the_first_to_go_leaves_the_loop_to_another(self, engine: Engine) -> None:
        """The other threads must not hang when the thread that ran the loop has its result and leaves."""
        delays = [0.05, 0.001, 0.03, 0.01, 0.02]
        done: list[int] = []

        def use(thread: int) -> None:
            for _ in range(10):
                done.append(engine.run(lambda: doubled(thread, delays[thread])))

        in_threads(5, use)
        assert len(done) == 50

    def test_in_a_coroutine_of_another_loop(self, engine: Engine) -> None:
        async def main() -> int:
            return engine.run(lambda: doubled(4, 0.001))

        assert asyncio.run(main()) == 8


class TestKeeper:
    def test_it_runs_the_loop_where_nobody_waits(self, engine: Engine) -> None:
        told: list[str] = []
        with engine.loop:  # both at once; otherwise a stall between them lets the first come first
            engine.loop.call_later(0.001, told.append, "later")
            engine.loop.call_soon(told.append, "soon")
        wait_until(lambda: len(told) == 2)
        assert told == ["soon", "later"]

    def test_what_is_put_off_does_not_wake_it(self, engine: Engine, monkeypatch: pytest.MonkeyPatch) -> None:
        nudges: list[int] = []
        monkeypatch.setattr(engine, "nudge", lambda: nudges.append(1))
        for _ in range(20):
            engine.run(lambda: doubled(3))  # the keeper has left the loop to this thread
            with engine.loop:
                engine.loop.deferred.append((int, ()))
                engine.settle()
        assert nudges == []

    def test_it_takes_over_again_and_again(self, engine: Engine) -> None:
        """As with a program that spins from time to time, and has long callbacks."""
        told: list[int] = []
        for number in range(5):
            engine.run(lambda: doubled(1))
            engine.call(engine.loop.call_later, 0.001, told.append, number)
            wait_until(lambda number=number: number in told)
        assert told == list(range(5))

    def test_a_task_goes_on_while_its_maker_is_away(self, engine: Engine) -> None:
        ticks = [0]

        async def tick() -> None:
            while True:
                await asyncio.sleep(0.001)
                ticks[0] += 1

        task = engine.call(engine.loop.create_task, tick())
        wait_until(lambda: ticks[0] >= 10)
        engine.call(task.cancel)
        wait_until(task.done)

    def test_nothing_is_left_after_the_end(self) -> None:
        before = set(threading.enumerate())
        first = engines.engine()
        assert engines.engine() is first is engines.current()
        assert first.run(lambda: doubled(1)) == 2
        engines.end()
        engines.end()
        assert engines.current() is None and first.loop.is_closed()
        assert engines.engine() is not first
        engines.end()
        assert set(threading.enumerate()) <= before

    def test_the_first_use_by_many_threads(self) -> None:
        found: list[Engine] = []
        barrier = threading.Barrier(6)

        def use(_: int) -> None:
            barrier.wait()
            found.append(engines.engine())

        try:
            in_threads(6, use)
            assert len(set(map(id, found))) == 1
        finally:
            engines.end()


class TestWaiters:
    def test_set_by_another_thread(self, engine: Engine) -> None:
        with engine.loop:
            waiter = Waiter(engine)
        timer = threading.Timer(0.02, engine.call, (waiter.set,))
        timer.start()
        with engine.loop:
            assert waiter.wait() is True
        timer.join()

    def test_one_that_is_set_already(self, engine: Engine) -> None:
        with engine.loop:
            waiter = Waiter(engine)
            waiter.set()
            assert waiter.wait() is True

    def test_a_deadline(self, engine: Engine) -> None:
        begin = time.monotonic_ns()
        with engine.loop:
            assert Waiter(engine).wait(begin + 20_000_000) is False
        assert time.monotonic_ns() - begin >= 20_000_000

    @pytest.mark.parametrize("is_eager", [False, True])
    def test_many_of_them(self, engine: Engine, is_eager: bool) -> None:
        """Each waiter is set by the one before, and no thread sleeps through that."""
        count = 6
        with engine.loop:
            waiters = [Waiter(engine) for _ in range(count)]
        rounds = [0] * count

        def use(index: int) -> None:
            for _ in range(40):
                with engine.loop:
                    assert waiters[index].wait(is_eager=is_eager)
                    waiters[index].is_set = False
                    rounds[index] += 1
                    waiters[(index + 1) % count].set()

        timer = threading.Timer(0.02, engine.call, (waiters[0].set,))
        timer.start()
        in_threads(count, use)
        timer.join()
        assert rounds == [40] * count


class TestInterrupts:
    @pytest.fixture
    def handled(self, engine: Engine) -> Iterator[list[bool]]:
        """Handle SIGUSR1 as the facade handles SIGINT."""
        handled: list[bool] = []

        def handler(number: int, frame: FrameType | None) -> None:
            is_busy = engine.is_busy(frame)
            handled.append(is_busy)
            if not is_busy:
                raise KeyboardInterrupt
            engine.interrupt()

        before = signal.signal(signal.SIGUSR1, handler)
        yield handled
        signal.signal(signal.SIGUSR1, before)

    def test_it_ends_a_wait(self, engine: Engine, handled: list[bool]) -> None:
        timer = after(0.02)
        with pytest.raises(KeyboardInterrupt):
            timer.start()
            engine.run(lambda: asyncio.sleep(LONG_S))
        timer.join()
        assert engine.run(lambda: doubled(1)) == 2

    def test_it_ends_a_wait_while_another_thread_runs_the_loop(
        self, engine: Engine, handled: list[bool]
    ) -> None:
        with another_runs_the_loop(engine) as other:
            timer = after(0.02)
            with pytest.raises(KeyboardInterrupt):
                timer.start()
                engine.run(lambda: asyncio.sleep(LONG_S))
            timer.join()
            assert other.is_alive()
        assert engine.run(lambda: doubled(1)) == 2

    def test_just_before_a_wait(self, engine: Engine, handled: list[bool]) -> None:
        """This is also true if another thread runs the loop, and nothing happens there that would end a
        wait.
        """
        delays = random.Random(3)
        with another_runs_the_loop(engine):
            for _ in range(60):
                timer = after(delays.random() * 0.002)
                with pytest.raises(KeyboardInterrupt):
                    timer.start()
                    while True:
                        engine.run(lambda: doubled(1))
                        with engine.loop:
                            Waiter(engine).wait()
                timer.join()
        gc.collect()

    def test_at_any_moment(self, engine: Engine, handled: list[bool]) -> None:
        """The interrupt is raised once, at any step of the main thread in the engine. The engine works
        afterwards.
        """
        delays = random.Random(7)
        for _ in range(60):
            timer = after(delays.random() * 0.004)
            with pytest.raises(KeyboardInterrupt):
                timer.start()
                while True:
                    engine.run(lambda: doubled(1, delays.choice((0, 0.0002, 0.001))))
                    engine.call(engine.loop.call_soon, int)
                    time.sleep(0)
            timer.join()
            assert not engine.loop.is_mine() and not engine.loop.is_interrupted
        gc.collect()  # the remains are freed here, where this disturbs nothing
        assert len(handled) == 60
        assert engine.run(lambda: doubled(2)) == 4
        in_threads(3, lambda index: engine.run(lambda: doubled(index)))


@contextmanager
def another_runs_the_loop(engine: Engine) -> Iterator[threading.Thread]:
    """A thread that waits, and so runs the loop, until the block ends."""
    with engine.loop:
        waiter = Waiter(engine)

    def spin() -> None:
        with engine.loop:
            waiter.wait(is_eager=True)

    other = threading.Thread(target=spin)
    other.start()
    wait_until(lambda: engine._runner is waiter)
    yield other
    engine.call(waiter.set)
    other.join(WAIT_S)


def after(delay_s: float) -> threading.Timer:
    """A timer that sends SIGUSR1 to the main thread. It may fire before `start` returns."""
    main: Any = threading.main_thread().ident
    return threading.Timer(delay_s, signal.pthread_kill, (main, signal.SIGUSR1))


def test_a_hammer(engine: Engine) -> None:
    """Four threads wait, call, and time out at random for half a second. None hangs, and no call is lost."""
    end = time.monotonic() + 0.5
    told: list[int] = []
    asked = [0] * 4

    def use(thread: int) -> None:
        choose = random.Random(thread)
        while time.monotonic() < end:
            what = choose.randrange(5)
            if what == 0:
                assert engine.run(lambda: doubled(thread)) == 2 * thread
            elif what == 1:
                assert engine.run(lambda: doubled(thread, choose.random() * 0.003)) == 2 * thread
            elif what == 2:
                with pytest.raises(TimeoutError):
                    engine.run(lambda: asyncio.sleep(LONG_S), timeout_s=choose.random() * 0.003)
            elif what == 3:
                engine.call(engine.loop.call_soon, told.append, thread)
                asked[thread] += 1
            else:
                engine.call(engine.loop.call_later, choose.random() * 0.003, told.append, thread)
                asked[thread] += 1

    in_threads(4, use)
    wait_until(lambda: len(told) == sum(asked))
    assert [told.count(thread) for thread in range(4)] == asked
