"""In asyncio's debug mode: says which callback has held the event loop up, and for how long.

asyncio has such a line too, with a loop's handle in it; this one has the name that the user knows. Without
the debug mode nothing is measured.
"""

import asyncio
from collections.abc import Callable, Coroutine, Generator
from functools import partial, wraps
from time import perf_counter
from types import coroutine
from typing import Any

from bus.base.callbacks import callback_name, is_async
from bus.logger import Logger

__all__ = ["SLOW_S", "watched"]

SLOW_S = 0.1


def watched(callback: Callable[..., Any], what: str, logger: Logger) -> Callable[..., Any]:
    """The callback of `what`; in debug mode one that warns, once, where a call takes longer than SLOW_S.

    Of an async one each part between two awaits counts by itself, as nothing else runs meanwhile.
    """
    if not asyncio.get_running_loop().get_debug():
        return callback
    is_warned = False

    def look(began: float) -> None:
        nonlocal is_warned
        took = perf_counter() - began
        if took > SLOW_S and not is_warned:
            is_warned = True
            logger.warning(
                f"callback {callback_name(callback)} of {what} took {took * 1e3:.0f} ms, while nothing else "
                "could run in this event loop (said once)"
            )

    if is_async(callback):

        @wraps(callback)
        async def call_async(*arguments: Any) -> Any:
            began = perf_counter()
            try:
                work = callback(*arguments)
            finally:
                look(began)
            return await _in_parts(work, look)

        return call_async

    @wraps(callback)
    def call(*arguments: Any) -> Any:
        began = perf_counter()
        try:
            return callback(*arguments)
        finally:
            look(began)

    return call


@coroutine
def _in_parts(work: Coroutine[Any, Any, Any], look: Callable[[float], None]) -> Generator[Any, Any, Any]:
    """Run a coroutine, with a look after each part of it."""
    go_on: Callable[[], Any] = partial(work.send, None)
    while True:
        began = perf_counter()
        try:
            awaited = go_on()
        except StopIteration as end:
            return end.value
        finally:
            look(began)
        try:
            go_on = partial(work.send, (yield awaited))
        except BaseException as error:
            go_on = partial(work.throw, error)
