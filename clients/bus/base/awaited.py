"""Coroutine functions that warn if the program forgets the `await`, and name the calling line.

Used for calls that make and close objects, because programmers with experience of rclpy forget it there.
Python's own warning names the line at which the coroutine was discarded, and an unawaited close would leave
its object open for ever.
"""

import asyncio
import inspect  # maybe not loaded yet: see bus.base.late_modules
import sys
import warnings
from collections.abc import Callable, Coroutine, Generator
from functools import wraps
from types import FrameType
from typing import Any, ParamSpec, TypeVar

from bus.base.late_modules import when_loaded

__all__ = ["done_anyway", "is_to_be_awaited", "mark_to_be_awaited", "to_be_awaited"]

P = ParamSpec("P")
T = TypeVar("T")

_MARK = "_is_to_be_awaited"
_tasks: set[asyncio.Task[Any]] = set()


def to_be_awaited(function: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, Coroutine[Any, Any, T]]:
    """Decorator: an unawaited call does nothing, and warns."""
    return _decorated(function, is_done_anyway=False)


def done_anyway(function: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, Coroutine[Any, Any, T]]:
    """Decorator: the event loop runs an unawaited call anyway, and warns."""
    return _decorated(function, is_done_anyway=True)


def is_to_be_awaited(function: object) -> bool:
    """Whether `function` was decorated like this; for a bound method, its function."""
    return hasattr(function, _MARK) or hasattr(getattr(function, "__self__", None), _MARK)


def _decorated(
    function: Callable[P, Coroutine[Any, Any, T]], *, is_done_anyway: bool
) -> Callable[P, Coroutine[Any, Any, T]]:
    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> Coroutine[Any, Any, T]:
        loop = asyncio._get_running_loop() if is_done_anyway else None
        return _Call(function(*args, **kwargs), sys._getframe(1), loop)

    mark_to_be_awaited(call)
    return call


def mark_to_be_awaited(function: Any) -> None:
    """Make `is_to_be_awaited` true for `function`, which is no `async def` but returns an awaitable.

    Frameworks call `asyncio.iscoroutinefunction`, or from Python 3.12 on the function of `inspect`. Python
    3.11's `inspect` only checks the code, and has no such mark.
    """
    setattr(function, _MARK, True)
    function._is_coroutine = getattr(asyncio.coroutines, "_is_coroutine", None)
    if sys.version_info >= (3, 12):
        when_loaded(inspect, lambda: inspect.markcoroutinefunction(function))


class _Call(Coroutine[Any, Any, T]):
    """A coroutine, and the line that made it; `loop` runs it if it is never awaited."""

    def __init__(
        self,
        coroutine: Coroutine[Any, Any, T],
        caller: FrameType,
        loop: asyncio.AbstractEventLoop | None,
    ) -> None:
        self._coroutine: Any = coroutine
        self._path = caller.f_code.co_filename
        self._line = caller.f_lineno
        self._loop = loop
        self._is_begun = self._is_explained = False

    def __await__(self) -> Generator[Any, None, T]:
        self._is_begun = True
        generator: Generator[Any, None, T] = self._coroutine.__await__()
        return generator

    def send(self, value: Any) -> Any:
        self._is_begun = True
        return self._coroutine.send(value)

    def throw(self, *what: Any) -> Any:
        self._is_begun = True
        return self._coroutine.throw(*what)

    def close(self) -> None:
        self._is_begun = True
        self._coroutine.close()

    def __repr__(self) -> str:
        return repr(self._coroutine)

    def __getattr__(self, name: str) -> Any:
        if name.startswith(("cr_", "__")):  # attributes that asyncio, inspect and debuggers read
            return getattr(self._coroutine, name)
        method = self._coroutine.__name__
        self._is_explained = True
        raise AttributeError(
            f"{method}(...) has no '{name}' before it is awaited: write await {method}(...) "
            f"in line {self._line} of {self._path}"
        )

    def __del__(self) -> None:
        if self._is_begun:
            return
        coroutine = self._coroutine
        owner = type(coroutine.cr_frame.f_locals["self"]).__name__
        text = f"coroutine '{owner}.{coroutine.__name__}' was never awaited"
        try:
            if self._loop is None:
                coroutine.close()
            else:
                self._loop.call_soon_threadsafe(_carry_out, self._loop, coroutine)
                text += "; it is done a little later"
        except RuntimeError:  # the loop has ended
            coroutine.close()
        if not self._is_explained and not sys.is_finalizing():
            warnings.warn_explicit(text, RuntimeWarning, self._path, self._line)


def _carry_out(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, Any]) -> None:
    task = loop.create_task(coroutine)
    _tasks.add(task)  # the loop itself only has a weak reference
    task.add_done_callback(_tasks.discard)
