"""What a user's callback is like: its name, whether it must be awaited, whether it wants a message's info."""

import inspect  # whose names are asked for only where they are needed: it takes a while to load
from collections.abc import Callable
from functools import partial
from types import FunctionType, MethodType
from typing import Final

from bus.base.awaited import is_to_be_awaited

__all__ = ["callback_name", "ignore", "is_async", "takes", "takes_info"]

_HAS_REST: Final = 0x04
_IS_COROUTINE: Final = 0x80
"""Flags of a function's code: it takes any number of arguments; it is `async def`."""


def callback_name(callback: Callable[..., object]) -> str:
    """The name that its author knows: of the function itself, where something is wrapped around it."""
    callback = inspect.unwrap(callback)
    while isinstance(callback, partial):
        callback = inspect.unwrap(callback.func)
    return getattr(callback, "__qualname__", type(callback).__qualname__)


def is_async(callback: Callable[..., object]) -> bool:
    """Whether what a call returns is to be awaited: async functions and methods, objects with such a call."""
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
    """Whether it needs a second argument; one with a default is the user's own."""
    if (function := _plain_function(callback)) is not None:
        given = len(function.__defaults__ or ()) + (function is not callback)
        return function.__code__.co_argcount - given >= 2
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError):  # some that are written in C
        return False
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in positional and one.default is one.empty for one in parameters) >= 2


def takes(callback: Callable[..., object], count: int) -> bool:
    """Whether it can be called with so many arguments; True where that can't be found out."""
    if (function := _plain_function(callback)) is not None:
        code = function.__code__
        most = code.co_argcount - (function is not callback)
        least = most - len(function.__defaults__ or ())
        if code.co_kwonlyargcount > len(function.__kwdefaults__ or ()):
            return False
        return least <= count and (count <= most or bool(code.co_flags & _HAS_REST))
    try:
        signature = inspect.signature(callback)
    except (TypeError, ValueError):  # some that are written in C
        return True
    try:
        signature.bind(*(None,) * count)
    except TypeError:
        return False
    return True


def _plain_function(callback: Callable[..., object]) -> FunctionType | None:
    """The plain function, or the function of a plain method; None where something is wrapped around it or
    marked on it.

    All that `inspect` would find out about such a function is in its code object.
    """
    function = callback.__func__ if isinstance(callback, MethodType) else callback
    return function if isinstance(function, FunctionType) and not function.__dict__ else None


def ignore(event: object) -> None:
    """Does nothing. Set as the callback of an event, it silences the warning that is the default."""
