"""Properties of a user's callback: its name, whether it must be awaited, whether it takes a message's
info."""

import inspect  # slow to load, so its names are only used if necessary
from collections.abc import Callable
from functools import partial
from types import FunctionType, MethodType
from typing import Final

from bus.base.awaited import is_to_be_awaited

__all__ = ["callback_name", "ignore", "is_async", "takes", "takes_info"]

_HAS_REST: Final = 0x04
_IS_COROUTINE: Final = 0x80
"""Flags of a function's code: it has `*args`; it is an `async def`."""


def callback_name(callback: Callable[..., object]) -> str:
    """The name that the author knows: that of the function itself, even if it is wrapped."""
    callback = inspect.unwrap(callback)
    while isinstance(callback, partial):
        callback = inspect.unwrap(callback.func)
    return getattr(callback, "__qualname__", type(callback).__qualname__)


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
