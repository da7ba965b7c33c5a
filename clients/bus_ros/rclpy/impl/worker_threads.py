"""Threads that make calls for an executor.

After a call, a thread stays for a while, and gets the next call by a queue: the futures of a pool cost more
than most calls. Owns the threads, their states (in a call or waiting) and their number. Must not know the
calls, groups, or the event loop.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from queue import Empty, SimpleQueue
from threading import get_ident
from typing import Generic, TypeVar

__all__ = ["WorkerThreads"]

C = TypeVar("C")

_STAY_S = 0.1


class WorkerThreads(Generic[C]):
    """Up to `number` threads, which call `work(call)`. "Under the guard" means: the caller holds it.

    `work` calls `stay` under the guard if its thread should continue. Raises ValueError if `number` is below
    1.
    """

    def __init__(
        self, number: int, work: Callable[[C], object], guard: AbstractContextManager[object], *, name: str
    ) -> None:
        self._pool = ThreadPoolExecutor(number, thread_name_prefix=name)
        self._work = work
        self._guard = guard
        self._calls: SimpleQueue[C | None] = SimpleQueue()
        self._waiting = 0
        self._busy: set[int] = set()

    def hand(self, call: C) -> None:
        """Under the guard: give a call to a thread. Raises RuntimeError after `end`, and at the exit."""
        if self._waiting:
            self._waiting -= 1
            self._calls.put(call)
        else:
            self._pool.submit(self._serve, call)

    def stay(self) -> None:
        """Under the guard, at the end of `work`: this thread waits for another call."""
        self._busy.discard(get_ident())
        self._waiting += 1

    def is_mine(self) -> bool:
        """Whether this thread is in `work`."""
        return get_ident() in self._busy

    def end(self) -> None:
        """Under the guard: take no more calls. Waiting threads leave; busy ones leave after their call."""
        for _ in range(self._waiting):
            self._calls.put(None)
        self._waiting = 0
        self._pool.shutdown(wait=False)

    def _serve(self, first: C) -> None:
        call: C | None = first
        thread = get_ident()
        while call is not None:
            self._busy.add(thread)
            self._work(call)
            if thread in self._busy:
                self._busy.discard(thread)
                return
            call = self._wait()

    def _wait(self) -> C | None:
        """The next call for this thread; None if it should leave."""
        try:
            return self._calls.get(timeout=_STAY_S)
        except Empty:
            pass
        with self._guard:
            if not self._calls.empty():  # handed over meanwhile
                return self._calls.get()
            self._waiting -= 1
            return None
