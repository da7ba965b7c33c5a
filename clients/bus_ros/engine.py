"""What moves the facade: one event loop for the process, run by whichever thread has to wait.

A thread that spins runs the loop itself, so that a message costs no change of threads. While that thread is
in a callback of the user's, no thread runs the loop; where that lasts, or no thread spins at all, the keeper,
a thread in the background (`bus_ros.keeper`), runs it: discovery and delivery go on. Owns the loop and the
waiting, and keeps what all executors share; must not know nodes or callbacks.

A thread that waits is woken by `Waiter.set`, for what it waits for is there, or by `Waiter.release`, to look
again. `Engine.settle` and `nudge` have the keeper run the loop; `GuardedLoop.wake` ends the loop's wait.
"""

import asyncio
import os
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from threading import Lock, get_ident
from time import monotonic_ns
from types import FrameType
from typing import Any, Protocol, TypeVar

from bus.errors import ForkError, again
from bus.process.shared_loop import GuardedLoop
from bus_ros.keeper import Keeper, KeeperState

T = TypeVar("T")

_ASLEEP = KeeperState.ASLEEP
_SHUT = (None,)
_TURN_S = 1.0


class Sleeper(Protocol):
    """A wait that a context ends."""

    def wake_up(self) -> None: ...


class Lifetime(Protocol):
    """A context as those see it that wait for its end."""

    @property
    def is_valid(self) -> bool: ...
    def ok(self) -> bool: ...
    def wake_at_end(self, sleeper: Sleeper) -> None: ...


class Engine:
    """`loop` is used under its guard: `with engine.loop`. "Under the guard" means: the caller holds it."""

    def __init__(self) -> None:
        self.loop = GuardedLoop()
        self._main_thread = threading.main_thread().ident
        self._main_waiter: Waiter | None = None
        self._hears_signals = False
        self.loop.on_signal = self._wake_main
        self._runner: Waiter | Engine | None = None  # runs the loop; the engine stands for the keeper
        self._blocked: deque[Waiter] = deque()  # these wait while another thread runs it
        self._turns = 0
        self._turns_seen = -1  # by the keeper
        self.held = 0
        """Callback groups that are held: executors look at groups while there are any."""
        self.passed_over: set[Sleeper] = set()
        """Executors that left something in line because of its group."""
        self.failure: ForkError | None = None
        self._keeper = Keeper(self.loop, self._keep)
        self._keeper.start()

    def run(
        self,
        function: Callable[[], Coroutine[Any, Any, T]],
        timeout_s: float | None = None,
        *,
        context: Lifetime | None = None,
    ) -> T:
        """Run a coroutine function on the loop to its end, from any thread without the guard.

        Returns its result. It is called here, for an interrupt must not come between a coroutine and its run.

        Raises TimeoutError, also where `context` is shut down meanwhile, and KeyboardInterrupt in the main
        thread; then the coroutine is cancelled.
        """
        deadline_ns = deadline_after(timeout_s)
        with self.loop:
            waiter = Waiter(self, context)
            task = self.loop.create_task(function())
            task.add_done_callback(waiter.set)
            waiter.wait(deadline_ns, is_eager=True)  # calls like this come in series: a node's endpoints
            is_done = task.done()
            if not is_done:
                task.cancel()
                self.settle()
        if is_done:
            return task.result()
        raise TimeoutError

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """Call `function` under the guard, which the caller may hold already; does not wait."""
        if self.loop.is_mine():
            return function(*arguments)
        with self.loop:
            result = function(*arguments)
            self.settle()
        return result

    def post(self, function: Callable[..., object], *arguments: Any) -> None:
        """As `call`, for what leaves the loop nothing to do."""
        if self.loop.is_mine():
            function(*arguments)
        else:
            with self.loop:
                function(*arguments)

    def is_main(self) -> bool:
        return get_ident() == self._main_thread

    def settle(self) -> None:
        """Under the guard: have the keeper run the loop now, where there is work and no thread runs it.

        What the loop has put off can wait for the next run: the caller's, if it is a callback.
        """
        if self._runner is None and self.loop.is_due:
            self.nudge()

    def interrupt(self) -> None:
        """In a signal's handler: the main thread raises KeyboardInterrupt when it gives the guard away."""
        self.loop.is_interrupted = True
        waiter = self._main_waiter
        if waiter is not None:
            self.loop.interrupt()
            waiter.release()

    def _wake_main(self) -> None:
        """Wake the main thread, for Python to run the handler: a signal may come just before its wait."""
        if self._main_waiter is not None:
            self._main_waiter.release()

    def is_busy(self, frame: FrameType | None) -> bool:
        """In a signal's handler that interrupted `frame`: whether to `interrupt`, or to raise at once."""
        return self._main_waiter is not None or self.loop.is_busy(frame)

    def nudge(self) -> None:
        """Have the keeper run the loop at once; also in a signal's handler."""
        self._keeper.nudge()

    def close(self) -> None:
        """Stop the keeper, and close the loop."""
        with self.loop:
            self._keeper.close()
            if self._runner is self:
                self.loop.stop()
        self._keeper.join()
        with self.loop:
            if self._runner is not None:
                return  # a daemon thread runs it, to the end of the process
            self._runner = self  # for good
            self.loop.forget_stop()
            self.loop.run_until_complete(_cancel_all(asyncio.all_tasks(self.loop)))
            self.loop.close()

    # --- for threads that wait, under the guard

    def wait(
        self,
        waiter: "Waiter",
        deadline_ns: int = 0,
        *,
        is_eager: bool = False,
        takes_at_once: bool = False,
    ) -> bool:
        """See `Waiter.wait`. `takes_at_once`: it takes whatever comes, before anything else is done."""
        if self.failure is not None:
            raise again(self.failure)
        loop = self.loop
        is_main = self.is_main()
        if is_main:
            self._main_waiter = waiter
            if not self._hears_signals:
                self._hears_signals = True
                loop.wake_on_signals()
        try:
            while not waiter.is_set:
                if is_main and loop.is_interrupted:
                    return False
                if self._runner is None and asyncio._get_running_loop() is None:
                    self._runner = waiter
                    if takes_at_once and not self.held:
                        waiter.shut.clear()
                    try:
                        loop.run(waiter, deadline_ns)
                    finally:
                        self._runner = None
                        waiter.shut[:] = _SHUT
                        self._turns += 1
                else:
                    self._block(waiter, deadline_ns, is_eager=is_eager)
                if deadline_ns and not waiter.is_set and monotonic_ns() >= deadline_ns:
                    return False
            return True
        finally:
            if is_main:
                self._main_waiter = None
            if self._blocked:
                self._pass_on()
            elif self._keeper.state is _ASLEEP:
                self._keeper.wake()

    def sleep(self, waiter: "Waiter", sleep: Callable[[int, int, float], Any], deadline_ns: int = 0) -> Any:
        """Wait without the loop for what `sleep` brings (`Reader.wait`), which wakes up in fewer steps.

        None where the loop has something to do, where the waiter is set, or another thread runs the loop:
        then `wait` sees to it.
        """
        is_main = get_ident() == self._main_thread
        if self._runner is not None or self.failure is not None or (is_main and not self._hears_signals):
            return None
        if asyncio._get_running_loop() is not None:
            return None
        self._runner = waiter
        if is_main:
            self._main_waiter = waiter
        try:
            return self.loop.wait_between(sleep, deadline_ns)
        finally:
            self._runner = None
            self._turns += 1
            if is_main:
                self._main_waiter = None
            if self._blocked:
                self._pass_on()
            elif self._keeper.state is _ASLEEP:
                self._keeper.wake()

    def is_waited_on(self, waiter: "Waiter") -> bool:
        """Whether a thread is in `wait` with it."""
        return self._runner is waiter or waiter in self._blocked

    def _block(self, waiter: "Waiter", deadline_ns: int, *, is_eager: bool) -> None:
        """Sleep while another thread runs the loop, or is about to."""
        if is_eager and self._runner is self:
            self._blocked.appendleft(waiter)
            self.loop.stop()
        else:
            self._blocked.append(waiter)
            if self._runner is None:
                self.nudge()
        timeout_s = (deadline_ns - monotonic_ns()) / 1e9 if deadline_ns else None
        if timeout_s is not None and timeout_s <= 0:
            self.loop.call_soon(waiter.release)  # when the turn that it gets in any case is over
            timeout_s = _TURN_S
        self.loop.release()
        try:
            waiter.block(timeout_s)
        finally:
            self.loop.acquire()
            with suppress(ValueError):
                self._blocked.remove(waiter)

    def _pass_on(self) -> None:
        """Have a thread that waits run the loop."""
        if self._runner is None and self._blocked:
            self._blocked.popleft().release()

    def _notify(self, waiter: "Waiter") -> None:
        """It is set: have its thread look."""
        if self._runner is waiter:
            self.loop.wake()
        else:
            waiter.release()

    def _keep(self, is_urgent: bool) -> bool:
        """The keeper's turn: run the loop if no thread did since the last turn, or at once.

        Returns whether the keeper may sleep: a thread has run the loop all the time.
        """
        is_idle = self._turns == self._turns_seen
        if self._runner is None and (is_idle or is_urgent):
            self._runner = self
            self.loop.run()
            self._runner = None
            self._turns += 1
            self._pass_on()
        self._turns_seen = self._turns
        return is_idle and self._runner is not None


async def _cancel_all(tasks: set[asyncio.Task[Any]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


class Waiter:
    """A thread's wait for something, or for the end of `context`. All under the guard, but for `release`."""

    __slots__ = ("__weakref__", "_engine", "_lock", "is_set", "shut")

    def __init__(self, engine: Engine, context: Lifetime | None = None) -> None:
        self.is_set = False
        self.shut = [*_SHUT]
        """Empty while its thread runs the loop, and takes each message as it comes."""
        self._engine = engine
        self._lock = Lock()
        self._lock.acquire()
        if context is not None:
            context.wake_at_end(self)
            self.is_set = not context.ok()

    def set(self, _: object = None) -> None:
        """What is waited for is there."""
        if not self.is_set:
            self.is_set = True
            engine = self._engine
            if engine._runner is not self or engine.loop.is_waiting:  # else it looks after this turn
                engine._notify(self)

    def wake_up(self) -> None:
        self.set()

    def wait(self, deadline_ns: int = 0, *, is_eager: bool = False) -> bool:
        """Wait until it is set; False at the deadline (0: none), and where the main thread is interrupted.

        The loop gets a turn in any case, also where the deadline is over.

        `is_eager`: the thread waits again and again, and had better run the loop itself.
        """
        return self._engine.wait(self, deadline_ns, is_eager=is_eager)

    def block(self, timeout_s: float | None) -> None:
        """Without the guard: sleep until `release`."""
        self._lock.acquire(True, -1 if timeout_s is None else timeout_s)

    def release(self) -> None:
        """Let it look again; from anywhere."""
        with suppress(RuntimeError):  # it is not blocked, and will look
            self._lock.release()


def deadline_after(timeout_s: float | None) -> int:
    """On the monotonic clock; 0 = none, for None and below zero."""
    return 0 if timeout_s is None or timeout_s < 0 else monotonic_ns() + round(timeout_s * 1e9)


_engine: Engine | None = None
_making = Lock()


def engine() -> Engine:
    """The engine of this process."""
    global _engine
    if _engine is None:
        with _making:
            if _engine is None:
                _engine = Engine()
    return _engine


def current() -> Engine | None:
    """The engine, if there is one already."""
    return _engine


def end() -> None:
    """Close the engine, if there is one; the next use makes another."""
    global _engine
    ended, _engine = _engine, None
    if ended is not None:
        ended.close()


def _forked() -> None:
    global _engine, _making
    ended, _engine, _making = _engine, None, Lock()
    if ended is not None:
        ended.loop.forget_signals()
        ended.loop.guard._at_fork_reinit()  # a thread may have held it that the child has not
        ended.failure = ForkError("rclpy was used before a fork; call rclpy.init() in the child process")


os.register_at_fork(after_in_child=_forked)
