"""The engine of the facade: one event loop for the process, run by a waiting thread.

A spinning thread runs the loop itself: a message needs no change of threads. While that thread is in a user's
callback, no thread runs the loop. If the callback lasts long, or no thread spins at all, the keeper
(`bus_ros.keeper`), a thread in the background, runs the loop: discovery and delivery go on. Owns the loop and
the waiting, and the state that all executors share. Must not know nodes or callbacks.

`Waiter.set` wakes a waiting thread because its event has happened; `Waiter.release` wakes it to look again.
`Engine.settle` and `nudge` make the keeper run the loop; `GuardedLoop.wake` ends the loop's wait.
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
    """A waiting object that the end of a context wakes."""

    def wake_up(self) -> None: ...


class Lifetime(Protocol):
    """A context, as an interface for objects that wait for its end."""

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
        self._blocked: deque[Waiter] = deque()  # waiting while another thread runs the loop
        self._turns = 0
        self._turns_seen = -1  # by the keeper
        self.held = 0
        """The number of held callback groups: executors check groups while it is not zero."""
        self.passed_over: set[Sleeper] = set()
        """Executors that left an entity in their queue because its group is held."""
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

        Returns its result. The function is called here: no interrupt can come between making the coroutine
        and running it.

        Raises TimeoutError, also if `context` is shut down meanwhile, and KeyboardInterrupt in the main
        thread. Both cancel the coroutine.
        """
        deadline_ns = deadline_after(timeout_s)
        with self.loop:
            waiter = Waiter(self, context)
            task = self.loop.create_task(function())
            task.add_done_callback(waiter.set)
            waiter.wait(deadline_ns, is_eager=True)  # such calls come in series: a node's endpoints
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
        """As `call`, for a function that leaves no work for the loop."""
        if self.loop.is_mine():
            function(*arguments)
        else:
            with self.loop:
                function(*arguments)

    def is_main(self) -> bool:
        return get_ident() == self._main_thread

    def settle(self) -> None:
        """Under the guard: make the keeper run the loop now, if there is work and no thread runs it.

        Deferred work of the loop can wait for the next run: by the caller, if it is a callback.
        """
        if self._runner is None and self.loop.is_due:
            self.nudge()

    def interrupt(self) -> None:
        """In a signal's handler: the main thread raises KeyboardInterrupt when it releases the guard."""
        self.loop.is_interrupted = True
        waiter = self._main_waiter
        if waiter is not None:
            self.loop.interrupt()
            waiter.release()

    def _wake_main(self) -> None:
        """Wake the main thread, which runs the signal's handler: a signal may come just before its wait."""
        if self._main_waiter is not None:
            self._main_waiter.release()

    def is_busy(self, frame: FrameType | None) -> bool:
        """In a signal's handler that interrupted `frame`: whether to `interrupt`, or to raise at once."""
        return self._main_waiter is not None or self.loop.is_busy(frame)

    def nudge(self) -> None:
        """Make the keeper run the loop at once; also in a signal's handler."""
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

    # --- for waiting threads, under the guard

    def wait(
        self,
        waiter: "Waiter",
        deadline_ns: int = 0,
        *,
        is_eager: bool = False,
        takes_at_once: bool = False,
    ) -> bool:
        """See `Waiter.wait`. `takes_at_once`: the thread takes each message before any other work is done."""
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
        """Wait without the loop for the result of `sleep` (`Reader.wait`), which wakes up in fewer steps.

        Returns None if the loop has work, if the waiter is set, or if another thread runs the loop. Then the
        caller uses `wait`.
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
            self.loop.call_soon(waiter.release)  # after the turn that the loop gets in any case
            timeout_s = _TURN_S
        self.loop.release()
        try:
            waiter.block(timeout_s)
        finally:
            self.loop.acquire()
            with suppress(ValueError):
                self._blocked.remove(waiter)

    def _pass_on(self) -> None:
        """Let a waiting thread run the loop."""
        if self._runner is None and self._blocked:
            self._blocked.popleft().release()

    def _notify(self, waiter: "Waiter") -> None:
        """The waiter is set: make its thread look."""
        if self._runner is waiter:
            self.loop.wake()
        else:
            waiter.release()

    def _keep(self, is_urgent: bool) -> bool:
        """The keeper's turn: run the loop if no thread did since the last turn, or at once if `is_urgent`.

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
    """A thread's wait for an event, or for the end of `context`. All under the guard, except `release`."""

    __slots__ = ("__weakref__", "_engine", "_lock", "is_set", "shut")

    def __init__(self, engine: Engine, context: Lifetime | None = None) -> None:
        self.is_set = False
        self.shut = [*_SHUT]
        """Empty while its thread runs the loop and takes each message as it comes."""
        self._engine = engine
        self._lock = Lock()
        self._lock.acquire()
        if context is not None:
            context.wake_at_end(self)
            self.is_set = not context.ok()

    def set(self, _: object = None) -> None:
        """The awaited event has happened."""
        if not self.is_set:
            self.is_set = True
            engine = self._engine
            if engine._runner is not self or engine.loop.is_waiting:  # else its thread looks after this turn
                engine._notify(self)

    def wake_up(self) -> None:
        self.set()

    def wait(self, deadline_ns: int = 0, *, is_eager: bool = False) -> bool:
        """Wait until it is set; False at the deadline (0: none), and if the main thread is interrupted.

        The loop gets a turn in any case, also after the deadline.

        `is_eager`: the thread waits again and again, so it should run the loop itself.
        """
        return self._engine.wait(self, deadline_ns, is_eager=is_eager)

    def block(self, timeout_s: float | None) -> None:
        """Without the guard: sleep until `release`."""
        self._lock.acquire(True, -1 if timeout_s is None else timeout_s)

    def release(self) -> None:
        """Make the thread look again; from any thread."""
        with suppress(RuntimeError):  # it is not blocked, and will look
            self._lock.release()


def deadline_after(timeout_s: float | None) -> int:
    """A deadline on the monotonic clock, in ns; 0 means none, for None and for a negative timeout."""
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
    """The engine, if it exists already."""
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
        ended.loop.guard._at_fork_reinit()  # a thread that is not in the child may have held it
        ended.failure = ForkError("rclpy was used before a fork; call rclpy.init() in the child process")


os.register_at_fork(after_in_child=_forked)
