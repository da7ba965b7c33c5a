"""An event loop that runs only while its thread waits: the engine of the blocking API.

It has no thread. Between two calls nothing runs: new messages wait in the rings and in the socket, and the
next call handles them. A call holds the guard (`bus.process.shared_loop`) while it works, and not while it
waits. So Ctrl-C takes effect at the end of a step, and other threads may publish. Knows loops, threads and
signals; must not know nodes.
"""

import asyncio
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine
from threading import get_ident
from time import monotonic_ns
from types import FrameType
from typing import Any, ClassVar, TypeVar

from bus.errors import BusError, ConfigurationError, ForkError, LocalProtocolError, again
from bus.process.shared_loop import GuardedLoop, Until
from bus.process.termination import ReaderGone, Terminated, drop_unread_output, say_nothing_of_signals

T = TypeVar("T")

_REST_NS = 5_000_000
"""Period of the loop's turns if a caller finds all its messages without the loop."""

_OFTEN_NS = 100_000
"""Period of checks for events while a caller publishes without a pause: a check costs more than a publish."""

_SIGNALS = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGPIPE: signal.SIG_IGN,
}
"""Signals, and their handlers in a program that has set none."""
_ENDS = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: Terminated, signal.SIGPIPE: ReaderGone}
_MOST_S = 1e9
_MOST_TURNS = 20


class Signal:
    """Ends a run of the loop when it is set; `set` may be a callback."""

    __slots__ = ("is_set",)

    def __init__(self) -> None:
        self.is_set = False

    def set(self, _: object = None) -> None:
        self.is_set = True


class Condition:
    """Like `Signal`, for a change without a callback: each turn of the loop checks it."""

    __slots__ = ("_look",)

    def __init__(self, look: Callable[[], bool]) -> None:
        self._look = look

    @property
    def is_set(self) -> bool:
        return self._look()


class Foreground:
    """The event loop of one thread; `acquire` returns it, `release` gives it back.

    Only that thread may call the methods. `loop` is used under its guard.
    """

    _all: ClassVar[list["Foreground"]] = []  # in the child of a fork also the parent's, which never end

    def __init__(self) -> None:
        self.loop = GuardedLoop()
        self.loop.rests = True
        self.failure: BusError | None = None
        self.thread = get_ident()
        self._users = 0
        self._attended_ns = self._asked_ns = 0
        self._heard: dict[int, Any] = {}  # handled signals, and their former handlers
        self._is_silent = False

    @classmethod
    def acquire(cls, instead: str) -> "Foreground":
        """This thread's loop.

        Raises LocalProtocolError, with the hint `instead`, if an event loop runs in it.
        """
        if asyncio._get_running_loop() is not None:
            raise LocalProtocolError(f"an event loop runs here, which must not be blocked: use {instead}")
        thread = get_ident()
        for one in cls._all:
            if one.thread == thread and one.failure is None:
                break
        else:
            one = cls()
            one._handle_signals()
            cls._all.append(one)
        one._users += 1
        return one

    def release(self) -> None:
        """Give the loop back; the last user closes it."""
        self._users -= 1
        if self._users or self.failure is not None:
            return
        Foreground._all.remove(self)
        loop = self.loop
        for task in asyncio.all_tasks(loop):
            task.cancel()
        self.attend()
        self._give_signals_back()
        loop.close()

    def dropped(self) -> None:
        """Handle a user of this loop that the collector has found, perhaps in another thread or during a
        call.

        If nothing can be done now, the loop continues with the next user's calls.
        """
        if self.may_attend():
            self.attend()
            self.release()
        else:
            self._users -= 1

    def may_attend(self) -> bool:
        """Whether `attend` is possible now. For the collector, which may run at any point."""
        return self.failure is None and self.is_free() and not self.loop.is_mine()

    def is_free(self) -> bool:
        """Whether the loop may run now: this is its own thread, in which no event loop runs."""
        return get_ident() == self.thread and asyncio._get_running_loop() is None

    def check(self) -> None:
        """Raise LocalProtocolError if this is the wrong thread or the wrong moment."""
        if self.failure is not None:
            raise again(self.failure)
        if get_ident() != self.thread:
            raise LocalProtocolError(
                "this node belongs to the thread that connected: in each thread make one with bus.connect"
            )
        if asyncio._get_running_loop() is not None:
            raise LocalProtocolError("an event loop runs here, which must not be blocked: use bus.Node")

    def run(self, function: Callable[[], Coroutine[Any, Any, T]], timeout_s: float | None = None) -> T:
        """Run a coroutine function to its end. After a cancellation it must end quickly.

        Raises TimeoutError and KeyboardInterrupt; before both, it cancels the coroutine.
        """
        self.check()
        deadline_ns = deadline_after(timeout_s)
        done = Signal()
        with self.loop:
            task = self.loop.create_task(function())
            task.add_done_callback(done.set)
            if not self.wait(done, deadline_ns):
                task.cancel()
                self.wait(done)
        if task.cancelled() or not task.done():
            raise TimeoutError
        return task.result()

    def run_or_tell(
        self, function: Callable[[], Coroutine[Any, Any, T]], timeout_s: float | None, tell: Callable[[], str]
    ) -> T:
        """As `run`; the text of TimeoutError begins with what `tell` returns."""
        try:
            return self.run(function, timeout_s)
        except TimeoutError as error:
            if timeout_s is None or error.args:
                raise
            raise TimeoutError(f"{tell()} within {timeout_s:g} s") from None

    def wait(self, until: Until, deadline_ns: int = 0) -> bool:
        """Under the guard: wait until `until` is set.

        False at the deadline (0: none), and at an interrupt.
        """
        loop = self.loop
        while not until.is_set:
            loop.run(until, deadline_ns)
            if loop.is_interrupted or (deadline_ns and monotonic_ns() >= deadline_ns):
                break
        return until.is_set

    def attend(self) -> None:
        """Handle events, without waiting for more; in its own thread, while no event loop runs there."""
        loop = self.loop
        if self.is_free() and loop.has_events():
            with loop.guard:
                for _ in range(_MOST_TURNS):
                    loop.run(deadline_ns=1)
                    if not loop.has_events():
                        break
            self._attended_ns = monotonic_ns()

    def attend_often(self) -> None:
        """As `attend`. If nothing is due, it polls the system at most once in a tenth of a millisecond."""
        now_ns = monotonic_ns()
        if self.loop.is_due or now_ns - self._asked_ns > _OFTEN_NS:
            self._asked_ns = now_ns
            self.attend()

    def attend_rarely(self) -> None:
        """As `attend`, if the last time was a while ago."""
        now_ns = monotonic_ns()
        if now_ns - self._attended_ns > _REST_NS:
            self._attended_ns = now_ns
            self.attend()

    # --- inside

    def _handle_signals(self) -> None:
        """In the main thread, if the program has no handlers: let Ctrl-C and SIGTERM end waits.

        During work, they take effect at the end of the step.
        """
        if threading.current_thread() is not threading.main_thread():
            return
        self.loop.wake_on_signals()
        for number, default in _SIGNALS.items():
            if signal.getsignal(number) == default:
                self._heard[number] = signal.signal(number, self._on_signal)

    def _give_signals_back(self) -> None:
        self.loop.forget_signals()
        for number, before in self._heard.items():
            if signal.getsignal(number) == self._on_signal:
                signal.signal(number, before)
        self._heard.clear()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGPIPE and not drop_unread_output():
            return  # another pipe or socket; the code that writes to it gets BrokenPipeError
        if not self._is_silent and not hasattr(sys, "ps1"):  # at an interactive prompt the user should see it
            self._is_silent = True
            say_nothing_of_signals()
        loop = self.loop
        loop.interruption = _ENDS[signal.Signals(number)]
        if loop.is_busy(frame):
            loop.is_interrupted = True
            loop.interrupt()
        else:
            raise loop.interruption

    @classmethod
    def _forked(cls) -> None:
        """In the child of a fork: a parent's loop may neither run nor end, because its epoll is the
        parent's."""
        for one in cls._all:
            if one.failure is None:
                one.failure = ForkError("this node was made before a fork; connect anew in the child process")
                one.loop.guard._at_fork_reinit()
                one._give_signals_back()


def deadline_after(timeout_s: float | None) -> int:
    """The deadline on the monotonic clock, 0 for None.

    Raises ConfigurationError if `timeout_s` is no time.
    """
    if timeout_s is None:
        return 0
    if not isinstance(timeout_s, int | float) or not 0 <= timeout_s <= _MOST_S:
        raise ConfigurationError(f"timeout {timeout_s!r} is not a number of seconds from 0, or None")
    return monotonic_ns() + round(timeout_s * 1e9)


os.register_at_fork(after_in_child=Foreground._forked)
