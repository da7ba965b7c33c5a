"""Executors: they wait until callbacks of their nodes are due, and call them, in one thread or in many."""

import os
import warnings
from collections.abc import Callable, Coroutine
from threading import get_ident
from time import monotonic_ns
from typing import Any

from bus_ros.engine import Waiter, deadline_after
from bus_ros.entity import Work
from bus_ros.rclpy.context import Context
from bus_ros.rclpy.executor import (
    MOST_AT_ONCE,
    ConditionReachedException,
    Executor,
    ExternalShutdownException,
    Ready,
    ShutdownException,
    Step,
    TimeoutException,
)
from bus_ros.rclpy.task import Future

__all__ = [
    "ConditionReachedException",
    "EventsExecutor",
    "Executor",
    "ExternalShutdownException",
    "MultiThreadedExecutor",
    "ShutdownException",
    "SingleThreadedExecutor",
    "TimeoutException",
    "await_or_execute",
]


_SHIFT_NS = 20_000_000
"""For so long a worker goes on by itself."""
_NOW: Future[Any] = Future()
_NOW.cancel()  # it is done: nobody waits for it


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call it, and await what it returns where that is a coroutine."""
    result = callback(*args)
    return await result if isinstance(result, Coroutine) else result


class SingleThreadedExecutor(Executor):
    """Calls back in the thread that spins."""

    def _spin_once(self, deadline_ns: int, most: int, until: Future[Any] | None = None) -> None:
        loop = self._engine.loop
        with loop.guard:
            found = self._next(deadline_ns, most, until)
            if found is not None:
                entity, work = found
                group = entity.held_group
                # In one thread, calls exclude each other anyway.
                holds_group = entity.is_async or (group is not None and group.is_shared)
                if holds_group:
                    self._begin(entity)
        if loop.is_interrupted:
            loop.check()
        if found is None:
            return
        if not holds_group and not isinstance(entity, Step):
            work[0](*work[1])
            return
        has_ended = True
        try:
            has_ended = self._run(entity, work)
        finally:
            if has_ended:
                with loop:
                    self._end(entity)


class MultiThreadedExecutor(Executor):
    """Calls back in `num_threads` threads, by default as many as there are CPUs.

    Under `spin`, a thread takes a run of messages of a subscription whose group is mutually exclusive.
    """

    asks_always = True  # a thread must be free

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        if num_threads is None:
            num_threads = len(os.sched_getaffinity(0))
        if num_threads == 1:
            warnings.warn(
                "MultiThreadedExecutor is used with a single thread.\n"
                "Use the SingleThreadedExecutor instead.",
                stacklevel=2,
            )
        self._threads = self._free = num_threads
        self._spinners = 0  # threads in `spin`, under which workers go on by themselves
        self._workers: set[int] = set()
        self._leaving: list[Waiter] = []  # they wait for the end of calls
        self._leavers = 0  # workers that shut down themselves, of which none waits for another
        from concurrent.futures import ThreadPoolExecutor  # late: most programs have no use for it

        self._pool = ThreadPoolExecutor(num_threads, thread_name_prefix="rclpy executor")

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop spinning, and wait until the calls have ended, for `timeout_sec` at most; returns whether.

        A call that does this itself is not waited for.
        """
        super().shutdown(timeout_sec)
        self._pool.shutdown(wait=False)
        engine, deadline_ns = self._engine, deadline_after(timeout_sec)
        with engine.loop:
            is_worker = get_ident() in self._workers
            self._leavers += is_worker
            self._tell_leaving()
            try:
                while self._threads - self._free > self._leavers:
                    waiter = Waiter(engine)
                    self._leaving.append(waiter)
                    if not waiter.wait(deadline_ns):
                        return False
                return True
            finally:
                self._leavers -= is_worker

    def _tell_leaving(self) -> None:
        leaving, self._leaving = self._leaving, []
        for waiter in leaving:
            waiter.set()

    def is_looking(self) -> bool:
        return self._free > 0 and super().is_looking()

    def _pop(self) -> "Ready | None":
        return super()._pop() if self._free else None

    def spin(self) -> None:
        if self.is_custom():
            super().spin()
            return
        with self._engine.loop:
            self._spinners += 1
        try:
            super().spin()
        finally:
            with self._engine.loop:
                self._spinners -= 1

    def _spin_once(self, deadline_ns: int, most: int, until: Future[Any] | None = None) -> None:
        with self._engine.loop:
            try:
                found = self._next(deadline_ns, most, until)
            except ExternalShutdownException:
                if self._context.was_ended_by_signal:
                    raise
                return  # one of our own calls may have shut down, and rclpy's spin just ends then
            if found is not None and not self.is_shutdown:
                try:
                    self._pool.submit(self._work, *found)
                except RuntimeError:  # the interpreter ends, and this is a daemon thread
                    self._is_shutdown = True
                    return
                self._begin(found[0])
                self._free -= 1

    def _work(self, entity: "Ready", work: Work) -> None:
        """Make a call, and under `spin` those that follow: a change of threads costs more than most calls."""
        self._workers.add(get_ident())
        end_ns = monotonic_ns() + _SHIFT_NS
        found: tuple[Ready, Work] | None = (entity, work)
        while found is not None:
            failure: BaseException | None = None
            has_ended = True
            try:
                has_ended = self._run(*found)
            except BaseException as error:
                failure = error
            with self._engine.loop:
                self._free += 1
                self._engine.passed_over.discard(self)  # this thread looks itself
                if has_ended:
                    self._end(found[0])
                found = None
                if failure is None and self._spinners and monotonic_ns() < end_ns:
                    try:
                        found = self._go_on()
                    except BaseException as error:
                        failure = error
                if failure is not None:
                    self._failures.append(failure)
                if found is None:
                    self._workers.discard(get_ident())
                    self.wake_up()
                    self._tell_leaving()

    def _go_on(self) -> "tuple[Ready, Work] | None":
        """What is ready now; another thread gets what else is."""
        if self._failures or not self._context.ok():
            return None
        found = self._next(0, MOST_AT_ONCE, _NOW)
        if found is None:
            return None
        self._begin(found[0])
        self._free -= 1
        if found[0].is_timer or (self._free and self._may_any_run()):
            self.wake_up()
        return found

    def _may_any_run(self) -> bool:
        for entity in self.ready:
            group = entity.held_group
            if group is None or group.can_execute(entity):
                return True
        if self.ready:
            self._engine.passed_over.add(self)
        return False


EventsExecutor = SingleThreadedExecutor
"""That of rclpy is another way to the same; here there is one."""
