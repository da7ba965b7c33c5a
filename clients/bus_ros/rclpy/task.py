"""Futures and tasks: results that come later, and the callbacks that executors run, step by step.

Owns their state, and the calls to make when they are done. Must not know executors: a task gets a function
that puts it into the executor's queue again. All methods may be called from any thread.
"""

import asyncio
import sys
import warnings
import weakref
from collections.abc import Callable, Coroutine, Generator, Iterable
from contextlib import suppress
from enum import Enum
from threading import Lock, local
from types import CoroutineType
from typing import Any, Generic, Protocol, TypeVar

from bus.base.printable import printable
from bus_ros.entity import Entity, Group, Work

__all__ = ["UNFINISHED", "Answer", "Future", "FutureState", "Step", "Task"]

T = TypeVar("T")


class _Driven(local):
    """The step of a task that runs in this thread."""

    in_loop: object = None
    """The loop of asyncio in which the step began. A program may spin in a task of asyncio, so a future must
    know which of the two awaits it."""


_driven = _Driven()


class FutureState(Enum):
    """The states of a future."""

    PENDING = "PENDING"
    CANCELLED = "CANCELLED"
    FINISHED = "FINISHED"


_PENDING, _CANCELLED, _FINISHED = FutureState
UNFINISHED = object()
"""Returned by a call that goes on later."""


class Executor(Protocol):
    """The interface of an executor for a future: it runs the callbacks."""

    def create_task(self, callback: Callable[..., object], *args: Any) -> object: ...


class Future(Generic[T]):
    """A result that will come: `await future` in an async callback or in asyncio, or add a callback.

    If the future has an executor, callbacks are tasks of it. Otherwise they run in the thread that sets the
    result.
    """

    _stays_cancelled = False
    """Whether a result after `cancel` is ignored."""

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._state = _PENDING
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._is_exception_seen = False
        self._callbacks: list[Callable[[Future[T]], object]] = []
        self._waiters: list[Callable[[], object]] = []
        self._lock = Lock()
        self._executor: weakref.ref[Executor] | None = None
        if executor is not None:
            self._set_executor(executor)

    def __del__(self) -> None:
        # The constructor of a subclass may have failed before this class's.
        error = getattr(self, "_exception", None)
        if error is not None and not self._is_exception_seen and sys.stderr is not None:
            text = printable(f"The following exception was never retrieved: {error}")
            print(text, file=sys.stderr)

    def __await__(self) -> Generator[Any, None, T | None]:
        while not self.done():
            loop = asyncio._get_running_loop()
            if loop is None or loop is _driven.in_loop:
                yield self
            else:
                yield from self._done_in(loop).__await__()
        return self.result()

    async def _done_in(self, loop: asyncio.AbstractEventLoop) -> None:
        """For a task of asyncio: wait until it is done. Cancelling that task does not cancel this future."""
        waiter: asyncio.Future[None] = loop.create_future()

        def end() -> None:
            if not waiter.done():
                waiter.set_result(None)

        def wake() -> None:
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(end)

        self.call_when_done(wake)
        try:
            await waiter
        finally:
            self.forget_waiter(wake)

    def cancel(self) -> None:
        """Cancel it, unless it is done. Callbacks are called; the result is None."""
        self._finish(_CANCELLED)

    def cancelled(self) -> bool:
        return self._state == _CANCELLED

    def done(self) -> bool:
        """Whether there is a result or an exception, or it was cancelled."""
        return self._state != _PENDING

    def result(self) -> T | None:
        """The result, None if there is none yet; raises the exception that was set."""
        error = self.exception()
        if error is not None:
            raise error
        return self._result

    def exception(self) -> BaseException | None:
        """The exception that was set."""
        self._is_exception_seen = True
        return self._exception

    def set_result(self, result: T) -> None:
        with self._lock:
            self._result = result
        self._finish(_FINISHED)

    def set_exception(self, exception: BaseException) -> None:
        with self._lock:
            self._exception = exception
            self._is_exception_seen = False
        self._finish(_FINISHED)

    def add_done_callback(self, callback: "Callable[[Future[T]], object]") -> None:
        """Call `callback(future)` once it is done; if it is done already, at once or by the executor.

        An exception in a callback becomes a warning. If the callback is called at once, its exception is
        raised here instead.
        """
        with self._lock:
            if self._state == _PENDING:
                self._callbacks.append(callback)
                return
        executor = self._get_executor()
        if executor is not None:
            executor.create_task(callback, self)
        else:
            callback(self)

    def remove_done_callback(self, callback: "Callable[[Future[T]], object]") -> bool:
        """Remove a callback; returns whether it was there."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True

    def call_when_done(self, waiter: Callable[[], object]) -> None:
        """For executors and waiting threads: call `waiter()`, which must be quick, when it is done.

        Unlike callbacks, these need no executor. If it is done already, `waiter` is called at once.
        """
        with self._lock:
            if self._state == _PENDING:
                self._waiters.append(waiter)
                return
        waiter()

    def forget_waiter(self, waiter: Callable[[], object]) -> None:
        """Undo `call_when_done`, once; does nothing if the waiter was called already."""
        with self._lock:
            if waiter in self._waiters:
                self._waiters.remove(waiter)

    def _finish(self, state: FutureState) -> None:
        with self._lock:
            if self._state != _PENDING:
                if state == _CANCELLED:
                    return
                if self._state == _CANCELLED and self._stays_cancelled:
                    self._result = self._exception = None
                    return
            self._state = state
            callbacks, self._callbacks = self._callbacks, []
            waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            waiter()
        executor = self._get_executor()
        for callback in callbacks:
            if executor is not None:
                executor.create_task(callback, self)
                continue
            try:
                callback(self)
            except Exception as error:  # there may be more callbacks
                warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=3)

    def _get_executor(self) -> Executor | None:
        return None if self._executor is None else self._executor()

    def _set_executor(self, executor: Executor | None) -> None:
        """Let this executor run the callbacks from now on; it is not kept alive."""
        self._executor = None if executor is None else weakref.ref(executor)


class Answer(Future[T]):
    """The future of a request. `cancel` also drops the request: its answer is ignored."""

    _stays_cancelled = True  # the answer may come at the same time, in another thread
    drop: "Callable[[Future[T]], object]"
    """Set by the client right after it is made."""

    def cancel(self) -> None:
        super().cancel()
        self.drop(self)


class Task(Future[T]):
    """A function or a coroutine that an executor runs: each call of the task is one step.

    A coroutine's step ends at an await of an unfinished future. Once the future is done, a thread calls
    `reschedule()`, which makes the executor call the task again. An exception of the handler becomes the
    task's exception; KeyboardInterrupt and its like are raised.
    """

    def __init__(
        self,
        handler: Callable[..., object] | Coroutine[Any, Any, Any],
        args: Iterable[Any] | None = None,
        kwargs: dict[str, Any] | None = None,
        executor: Executor | None = None,
        reschedule: Callable[[], object] | None = None,
    ) -> None:
        super().__init__(executor=executor)
        self._handler: Any = handler
        self._args = args or ()
        self._kwargs = kwargs or {}
        self.reschedule = reschedule
        self._executing = False
        self._task_lock = Lock()

    def __call__(self) -> None:
        """Run the function, or the coroutine's next step. Does nothing if it is done or running."""
        self._advance()

    def _advance(self) -> bool:
        """As a call; returns whether the task goes on later. Another thread may have ended it by then."""
        if self._state != _PENDING:
            return False
        if not self._task_lock.acquire(blocking=False):
            return True
        awaited: Future[Any] | None = None
        try:
            self._executing = True
            awaited = self._step()
        except Exception as error:
            self._handler = None
            self.set_exception(error)
        finally:
            self._executing = False
            self._task_lock.release()
        if self._state != _PENDING:
            self._forget_handler()
            return False
        # Only after the lock is free: the next step may begin at once, in another thread.
        self._go_on_after(awaited)
        return True

    def executing(self) -> bool:
        """Whether a step is running now."""
        return self._executing

    def cancel(self) -> None:
        """Cancel it; a waiting coroutine is closed."""
        super().cancel()
        self._forget_handler()

    def _step(self) -> Future[Any] | None:
        """Run a step; returns the future that the coroutine awaits, or None if it yields or is done."""
        if not isinstance(self._handler, CoroutineType):  # a function, `def` or `async def`
            result = self._handler(*self._args, **self._kwargs)
            if not isinstance(result, CoroutineType):
                self.set_result(result)
                return None
            self._handler = result
        try:
            return _resume(self._handler)
        except StopIteration as end:
            self.set_result(end.value)
            return None

    def _go_on_after(self, awaited: Future[Any] | None) -> None:
        """Take the next step once `awaited` is done; None: soon."""
        if awaited is not None:
            awaited.call_when_done(self._wake)
        else:
            self._wake()

    def _wake(self) -> None:
        if self.reschedule is not None:
            self.reschedule()

    def _forget_handler(self) -> None:
        """Drop handler and arguments; if a step is running, it does so at its end."""
        if not self._task_lock.acquire(blocking=False):
            return
        try:
            handler, self._handler = self._handler, None
            self._args, self._kwargs = (), {}
            if isinstance(handler, CoroutineType):
                handler.close()
        finally:
            self._task_lock.release()


def begin(
    coroutine: Coroutine[Any, Any, Any], make_task: Callable[[Coroutine[Any, Any, Any]], Task[Any]]
) -> object:
    """Run a callback's coroutine; returns UNFINISHED if it goes on later, as the task that `make_task` makes.

    Most callbacks await nothing unfinished, and need no task. Raises the coroutine's exception.
    """
    try:
        awaited = _resume(coroutine)
    except StopIteration:
        return None
    make_task(coroutine)._go_on_after(awaited)
    return UNFINISHED


def _resume(coroutine: Coroutine[Any, Any, Any]) -> Future[Any] | None:
    """Run a step of a coroutine; returns the future that it awaits, or None if it yields.

    Raises StopIteration at its end.
    """
    outer, _driven.in_loop = _driven.in_loop, asyncio._get_running_loop()
    try:
        awaited = coroutine.send(None)
        if awaited is None or isinstance(awaited, Future):
            return awaited
        # Thrown into the coroutine: the traceback then shows the wrong await.
        coroutine.throw(
            TypeError(
                f"a callback can await rclpy's futures and other callbacks only, not {awaited!r}:"
                " no asyncio loop runs in an executor"
            )
        )
    finally:
        _driven.in_loop = outer
    return None


class Step:
    """A step of a task, which an executor queues in the same way as entities.

    The task holds the group of the entity `holder` until its end. `go_on` queues the step again.
    """

    is_async = False
    is_exclusive = False
    is_single = True
    is_timer = False
    is_step = True
    is_closed = False
    place = (-1, 0)

    def __init__(self, task: Task[Any], go_on: "Callable[[Step], object]", holder: Entity | None) -> None:
        self.task = task
        self.task.reschedule = self.again
        self.holder = holder
        self.ends_itself = False
        """The end of the task also releases the holder's group, in any thread."""
        self.held_group: Group | None = None
        self.is_destroyed = False
        self.is_queued = False
        self.node = None
        self._go_on = go_on

    def take(self, most: int) -> Work:
        return self.run, ()

    def run(self) -> object:
        """Run the step; returns UNFINISHED if the task goes on later; raises the task's exception."""
        if self.task._advance():
            return UNFINISHED
        if (error := self.task.exception()) is not None:
            raise error
        return None

    def again(self) -> None:
        self._go_on(self)
