"""An event loop that threads share: one thread runs it, and while it waits, others may use its objects.

asyncio's own loop belongs to one thread; other threads can only send it calls, which costs a change of
threads each way. Here a lock, the guard, protects the loop and all its objects. The thread that runs the loop
holds the guard except while it waits. So another thread with the guard may make the same calls as the loop's
own callbacks, except coroutines. Knows nothing about the bus.
"""

import asyncio
import select
import selectors
import signal
import socket
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from contextvars import Context
from heapq import heapify, heappop
from math import ceil
from threading import RLock, get_ident, main_thread
from types import FrameType
from typing import Any, Protocol

_FINE_S = 0.02
"""Shorter waits are exact to microseconds; epoll only has milliseconds."""

_YIELD_S = 20e-6
_NOBODY = -1
_MOST_SELECTABLE = 1024
_MANY_CANCELLED = 100


class Until(Protocol):
    """Ends a run of the loop when it is set."""

    @property
    def is_set(self) -> bool:
        """If True, the run ends after this turn."""


class _ForEver:
    is_set = False


_FOR_EVER = _ForEver()


class GuardedLoop(asyncio.SelectorEventLoop):
    """A loop with a guard.

    Hold it with `with loop:`; or with `with loop.guard:`, which is quicker, and then `check`. Any thread may
    run the loop (`run`), one at a time; it must hold the guard, once.

    A signal handler must not raise KeyboardInterrupt while the guard protects a change (see `is_busy`). Then
    it sets `is_interrupted`, and the main thread raises KeyboardInterrupt after it has released the guard.
    """

    # asyncio's own attributes, which typeshed does not have.
    _ready: deque[Any]
    _scheduled: list[Any]
    _stopping: bool
    _timer_cancelled_count: int
    _clock_resolution: float
    _thread_id: int | None
    _csock: socket.socket

    def __init__(self) -> None:
        self.is_interrupted = False
        self.interruption: type[KeyboardInterrupt] = KeyboardInterrupt
        """The class of the error that `check` raises."""
        self.deferred: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        """Calls, with their arguments, that can wait for the next run."""
        self.rests = False
        """Whether the loop runs only while a call waits (`foreground`): then a pause in between is no
        standstill."""
        self._main_thread = main_thread().ident
        self.guard: Any = RLock()
        self.is_mine: Callable[[], bool] = self.guard._is_owned  # type: ignore[attr-defined]
        """Whether this thread holds the guard. The call needs no Python frame."""
        self.on_signal: Callable[[], object] = int
        self._signals = _NOBODY
        self._contenders: deque[None] = deque()  # its methods are atomic
        self.is_waiting = False
        """Whether the thread that runs the loop waits for events."""
        selector: Any = selectors.EpollSelector()
        self._epoll: select.epoll = selector._selector
        self._epoll_number = self._epoll.fileno()
        self._keys: dict[int, selectors.SelectorKey] = selector._fd_to_key
        super().__init__(selector)

    def __del__(self) -> None:
        # Not set if a signal interrupted the constructor: there is nothing to close yet.
        if hasattr(self, "_signal_handlers"):
            super().__del__()

    def __enter__(self) -> None:
        if not self.guard.acquire(False):
            self.acquire()

    def __exit__(self, *_: object) -> None:
        self.guard.release()
        if self.is_interrupted:
            self.check()

    def check(self) -> None:
        """Without the guard: raise a pending KeyboardInterrupt."""
        if self.is_interrupted and get_ident() == self._main_thread:
            self.is_interrupted = False
            raise self.interruption

    def acquire(self) -> None:
        """Take the guard."""
        if not self.guard.acquire(False):
            self._contenders.append(None)
            self.guard.acquire()
            self._contenders.pop()

    def release(self) -> None:
        """Release the guard, without a check for interrupts."""
        self.guard.release()

    def is_busy(self, frame: FrameType | None) -> bool:
        """In a signal handler that interrupted `frame`: whether the main thread must not raise an error
        now."""
        while frame is not None and frame.f_code not in _ABOUT_TO_TAKE:
            frame = frame.f_back  # a second Ctrl-C may interrupt the handler itself
        return frame is not None or self.is_mine()

    def wake(self) -> None:
        """End the wait for events. May be called in a signal handler, and without the guard."""
        self._write_to_self()  # type: ignore[attr-defined]

    def interrupt(self) -> None:
        """Let a run end soon. May be called anywhere, as `wake`."""
        self._stopping = True
        self.wake()

    def wake_on_signals(self) -> None:
        """In the main thread: let signals end the wait for events, and call `on_signal`.

        Without this, Python handles a signal that comes just before the wait only when the wait is over. Does
        nothing if other code has done the same. `close` undoes it.
        """
        self._signals = self._csock.fileno()
        _replace_wakeup_fd(self._signals, instead_of=_NOBODY)

    def forget_signals(self) -> None:
        """Undo `wake_on_signals`, in the main thread."""
        if self._signals != _NOBODY:
            with suppress(ValueError):  # another thread, in a process that Python did not start
                _replace_wakeup_fd(_NOBODY, instead_of=self._signals)
            self._signals = _NOBODY

    @property
    def is_due(self) -> bool:
        """Whether calls wait, without regard to timers and descriptors."""
        return bool(self._ready)

    def has_events(self) -> bool:
        """Whether a run would have anything to do at once."""
        scheduled = self._scheduled
        return bool(
            self._ready or self._epoll.poll(0, 1) or (scheduled and scheduled[0]._when <= time.monotonic())
        )

    def stop(self) -> None:
        self._stopping = True
        if self.is_waiting:
            self.wake()

    def run(
        self, until: Until = _FOR_EVER, deadline_ns: int = 0, look: Callable[[], Any] | None = None
    ) -> Any:
        """As `run_forever`, until `stop`, until `until.is_set`, or `deadline_ns` on the monotonic clock.

        Each turn does less than asyncio's, because a call waits for its result: readers of descriptors are
        called first, and without a context. Before them, if there are events, `look` may find the awaited
        result. Then this returns it at once, and the next run handles the events.
        """
        ready, deferred, guard, keys = self._ready, self.deferred, self.guard, self._keys
        self._thread_id = get_ident()
        asyncio._set_running_loop(self)
        try:
            while True:
                while deferred:
                    callback, args = deferred.popleft()
                    callback(*args)
                timeout_s = 0.0 if ready or self._stopping else self._time_left(deadline_ns)
                self.is_waiting = True
                guard.release()
                try:
                    if self._contenders:
                        time.sleep(_YIELD_S)  # a lock is not fair: give waiting threads time to take it
                    events = self._epoll.poll() if timeout_s < 0 else self._poll(timeout_s)
                finally:
                    guard.acquire()
                    self.is_waiting = False
                if events and look is not None and (found := look()):
                    return found
                for descriptor, event in events:
                    key = keys.get(descriptor)
                    if key is not None:
                        reader, writer = key.data
                        if reader is not None and event & ~select.EPOLLOUT and not reader._cancelled:
                            try:
                                reader._callback(*reader._args)
                            except Exception as error:
                                self._complain(reader, error)
                        if writer is not None and event & ~select.EPOLLIN:
                            ready.append(writer)
                if until.is_set:
                    return None  # the rest can wait for the next run
                self._call_ready()
                if until.is_set or self._stopping:
                    return None
                if deadline_ns and time.monotonic_ns() >= deadline_ns:
                    return None
        finally:
            self._stopping = False
            self._thread_id = None
            asyncio._set_running_loop(None)

    def wait(self, sleep: Callable[[int, int, float], Any], deadline_ns: int = 0) -> Any:
        """Without the guard, in the thread that runs the loop: return the result of `sleep` instead of a run.

        If there is nothing to do, `sleep(epoll, deadline_ns, due_s)` sleeps until there is. It uses the
        descriptor with all events, and ends at the latest at one of these times (0: none). None: a `run` is
        necessary. An interrupt need not wait, because nothing is guarded here.
        """
        self.is_waiting = True  # first: a thread that adds a call from now on wakes the loop
        try:
            if self._ready or self.deferred or self._stopping:
                return None
            scheduled = self._scheduled
            return sleep(self._epoll_number, deadline_ns, scheduled[0]._when if scheduled else 0.0)
        finally:
            self.is_waiting = False

    def wait_between(self, sleep: Callable[[int, int, float], Any], deadline_ns: int = 0) -> Any:
        """As `wait`, but under the guard, which other threads may take meanwhile, and while no thread runs
        the loop."""
        if self.deferred:
            self._call_deferred()
        if self._ready or self._stopping or self._contenders:
            return None
        scheduled = self._scheduled
        due_s = scheduled[0]._when if scheduled else 0.0
        self.is_waiting = True  # first: a thread that takes the guard from now on wakes the loop
        self.guard.release()
        try:
            return sleep(self._epoll_number, deadline_ns, due_s)
        finally:
            self.guard.acquire()
            self.is_waiting = False

    def forget_stop(self) -> None:
        """Forget a `stop` that came between runs: it must not end the next run."""
        self._stopping = False

    # --- called by asyncio

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        handle = super().call_soon(callback, *args, context=context)
        if self.is_waiting:
            self.wake()
        return handle

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        handle = super().call_at(when, callback, *args, context=context)
        if self.is_waiting:
            self.wake()
        return handle

    def close(self) -> None:
        self.forget_signals()
        super().close()

    def _process_self_data(self, data: bytes) -> None:
        if any(data):
            self.on_signal()

    def _check_thread(self) -> None:
        """Allow all threads, because they hold the guard. asyncio calls this in debug mode."""

    # --- inside

    def _call_deferred(self) -> None:
        """Make the deferred calls, at the beginning of a run."""
        asyncio._set_running_loop(self)
        try:
            while self.deferred:
                callback, args = self.deferred.popleft()
                callback(*args)
        finally:
            asyncio._set_running_loop(None)

    def _call_ready(self) -> None:
        """Call due timers and scheduled callbacks."""
        ready, scheduled = self._ready, self._scheduled
        if scheduled:
            now = time.monotonic() + self._clock_resolution
            while scheduled and scheduled[0]._when < now:
                timer = heappop(scheduled)
                timer._scheduled = False
                ready.append(timer)
        for _ in range(len(ready)):
            handle = ready.popleft()
            if not handle._cancelled:
                handle._run()

    def _time_left(self, deadline_ns: int) -> float:
        """Seconds until the next timer or the deadline; -1 if there is neither."""
        scheduled = self._scheduled
        if self._timer_cancelled_count > _MANY_CANCELLED:
            scheduled[:] = [timer for timer in scheduled if not timer._cancelled]
            heapify(scheduled)
            self._timer_cancelled_count = 0
        while scheduled and scheduled[0]._cancelled:
            self._timer_cancelled_count -= 1
            heappop(scheduled)._scheduled = False
        end = scheduled[0]._when if scheduled else 0
        if deadline_ns and not 0 < end < deadline_ns / 1e9:
            end = deadline_ns / 1e9
        return max(end - time.monotonic(), 0) if end else -1

    def _complain(self, handle: Any, error: Exception) -> None:
        self.call_exception_handler({"message": "reading", "exception": error, "handle": handle})

    def _poll(self, timeout_s: float) -> list[tuple[int, int]]:
        epoll = self._epoll
        if 0 < timeout_s < _FINE_S and epoll.fileno() < _MOST_SELECTABLE:
            if not select.select((epoll.fileno(),), (), (), timeout_s)[0]:
                return []
            timeout_s = 0
        return epoll.poll(ceil(timeout_s * 1e3) * 1e-3)


def _replace_wakeup_fd(descriptor: int, *, instead_of: int) -> None:
    before = signal.set_wakeup_fd(descriptor, warn_on_full_buffer=False)
    if before != instead_of:
        signal.set_wakeup_fd(before)


_ABOUT_TO_TAKE = {
    method.__code__
    for method in (GuardedLoop.acquire, GuardedLoop.run, GuardedLoop._poll, GuardedLoop.wait_between)
}
"""Code that is about to take the guard, and calls `check` after its release.

In all other code outside the guard, an interrupt must not wait, because `check` may never be called.
"""
