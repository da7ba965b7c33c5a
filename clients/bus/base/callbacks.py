"""Properties of a user's callback: its name, whether it must be awaited, whether it takes a message's
info; and the call of one that must be awaited."""

import asyncio
import inspect  # slow to load, so its names are only used if necessary
from collections.abc import Awaitable, Callable
from functools import partial
from types import CoroutineType, FunctionType, MethodType
from typing import Any, Final, TypeVar

from bus.base.awaited import is_to_be_awaited

__all__ = [
    "call_async",
    "callback_name",
    "callback_place",
    "ignore",
    "is_async",
    "refuse_coroutine",
    "takes",
    "takes_info",
]

R = TypeVar("R")

_HAS_REST: Final = 0x04
_IS_COROUTINE: Final = 0x80
"""Flags of a function's code: it has `*args`; it is an `async def`."""


async def call_async(callback: Callable[..., Awaitable[R]], *arguments: object) -> R:
    """Call a callback, and await its result.

    Raises RuntimeError if it awaited a cancelled task: its CancelledError would silently end the task that
    calls back, though the program has not cancelled that task.
    """
    try:
        return await callback(*arguments)
    except asyncio.CancelledError as error:
        task = asyncio.current_task()
        if task is None or task.cancelling():
            raise
        text = f"callback {callback_name(callback)}{callback_place(callback)} awaited a cancelled task"
        raise RuntimeError(text) from error


def callback_name(callback: Callable[..., object]) -> str:
    """The name that the author knows: the function's own name, even if it is wrapped."""
    callback = inspect.unwrap(callback)
    while isinstance(callback, partial):
        callback = inspect.unwrap(callback.func)
    return getattr(callback, "__qualname__", type(callback).__qualname__)


def callback_place(callback: Callable[..., object]) -> str:
    """Module and line, as ` (module:12)`; nothing for callables without Python code."""
    function: Any = inspect.unwrap(callback)
    while isinstance(function, partial):
        function = inspect.unwrap(function.func)
    code = getattr(function, "__code__", None)
    return "" if code is None else f" ({function.__module__}:{code.co_firstlineno})"


def refuse_coroutine(callback: Callable[..., object], answer: object) -> None:
    """Raises TypeError if a callback that is not async has returned a coroutine: nothing would run it.

    The native reader calls this, too, with awaitable objects.
    """
    if isinstance(answer, CoroutineType):
        answer.close()  # otherwise Python warns, and names a line of the caller
        raise TypeError(
            f"callback {callback_name(callback)}{callback_place(callback)} returned the coroutine "
            f"{answer.__qualname__}, which nothing would run: make the callback async def, or pass the async "
            "def itself, or functools.partial of it"
        )


def is_async(callback: Callable[..., object]) -> bool:
    """Whether the result of a call must be awaited: for async functions and methods, and objects with an
    async `__call__`."""
    while isinstance(callback, partial):
        callback = callback.func
    if (function := _plain_function(callback)) is not None:
        return bool(function.__code__.co_flags & _IS_COROUTINE)
    call = getattr(callback, "__call__", None)  # noqa: B004
    return (
        inspect.iscoroutinefunction(callback)
        or inspect.iscoroutinefunction(call)
        or is_to_be_awaited(callback)
    )


def takes_info(callback: Callable[..., object]) -> bool:
    """Whether the callback needs a second argument; one with a default is for the user."""
    if (function := _plain_function(callback)) is not None:
        given = len(function.__defaults__ or ()) + (function is not callback)
        return function.__code__.co_argcount - given >= 2
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):  # some functions in C
        return False
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in positional and one.default is one.empty for one in parameters) >= 2


def takes(callback: Callable[..., object], count: int) -> bool:
    """Whether the callback can be called with `count` arguments; True if that is unknown."""
    if (function := _plain_function(callback)) is not None:
        code = function.__code__
        most = code.co_argcount - (function is not callback)
        least = most - len(function.__defaults__ or ())
        if code.co_kwonlyargcount > len(function.__kwdefaults__ or ()):
            return False
        return least <= count and (count <= most or bool(code.co_flags & _HAS_REST))
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):  # some functions in C
        return True
    try:
        signature.bind(*(None,) * count)
    except TypeError:
        return False
    return True


def _plain_function(callback: Callable[..., object]) -> FunctionType | None:
    """The plain function, or the function of a plain method; None if it is wrapped or marked.

    The code object of such a function has all the information that `inspect` would return.
    """
    function = callback.__func__ if isinstance(callback, MethodType) else callback
    return function if isinstance(function, FunctionType) and not function.__dict__ else None


def ignore(event: object) -> None:
    """Does nothing. Set as the callback of an event, it silences the warning that is the default."""
