"""What a user's callback is like: its name, whether it must be awaited, whether it wants a message's info."""

from collections.abc import Callable
from functools import partial
from inspect import CO_COROUTINE, Parameter, iscoroutinefunction, signature, unwrap
from types import FunctionType, MethodType

from bus.base.awaited import is_to_be_awaited

__all__ = ["callback_name", "ignore", "is_async", "takes_info"]


def callback_name(callback: Callable[..., object]) -> str:
    """The name that its author knows: of the function itself, where something is wrapped around it."""
    callback = unwrap(callback)
    while isinstance(callback, partial):
        callback = unwrap(callback.func)
    return getattr(callback, "__qualname__", type(callback).__qualname__)


def is_async(callback: Callable[..., object]) -> bool:
    """Whether what a call returns is to be awaited: async functions and methods, objects with such a call."""
    while isinstance(callback, partial):
        callback = callback.func
    if (function := _plain_function(callback)) is not None:
        return bool(function.__code__.co_flags & CO_COROUTINE)
    call = getattr(callback, "__call__", None)  # noqa: B004
    return iscoroutinefunction(callback) or iscoroutinefunction(call) or is_to_be_awaited(callback)


def takes_info(callback: Callable[..., object]) -> bool:
    """Whether it needs a second argument; one with a default is the user's own."""
    if (function := _plain_function(callback)) is not None:
        given = len(function.__defaults__ or ()) + (function is not callback)
        return function.__code__.co_argcount - given >= 2
    try:
        parameters = signature(callback).parameters.values()
    except (TypeError, ValueError):  # some that are written in C
        return False
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in positional and one.default is Parameter.empty for one in parameters) >= 2


def _plain_function(callback: Callable[..., object]) -> FunctionType | None:
    """The plain function, or the function of a plain method; None where something is wrapped around it or
    marked on it.

    All that `inspect` would find out about such a function is in its code object.
    """
    function = callback.__func__ if isinstance(callback, MethodType) else callback
    return function if isinstance(function, FunctionType) and not function.__dict__ else None


def ignore(event: object) -> None:
    """Does nothing. Set as the callback of an event, it silences the warning that is the default."""
