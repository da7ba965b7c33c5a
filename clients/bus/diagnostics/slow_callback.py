"""Reports callbacks that have blocked the event loop, with their time: once for each callback.

Nothing else in the loop runs meanwhile: messages wait or are replaced, timers miss calls. asyncio's debug
mode has such a line, too, which shows a handle of the loop. This line has the name that the user knows.

The callers of plain callbacks of subscriptions time them (`bus.delivery.dispatcher`, and the native core),
because a wrapper would cost a tenth of a quick message. All other callbacks are wrapped.
"""

from collections.abc import Awaitable, Callable, Coroutine, Generator
from functools import partial, wraps
from time import monotonic_ns
from types import CoroutineType, coroutine
from typing import Any

from bus.base.awaited import mark_to_be_awaited
from bus.base.callbacks import callback_name, callback_place, is_async
from bus.logger import Logger
from bus.names import is_hidden_node

__all__ = ["SLOW_NS", "timed_by_caller", "watched"]

SLOW_NS = 200_000_000
"""A callback that blocks the event loop for this time is reported; the native core has the same number."""


class SlowWatch:
    """Warns about `callback`, the callback of `what`."""

    __slots__ = ("_callback", "_is_warned", "_logger", "_what")

    def __init__(self, callback: Callable[..., Any], what: str, logger: Logger) -> None:
        self._callback = callback
        self._what = what
        self._logger = logger
        # A hidden node belongs to a tool, whose user has no callback to fix.
        self._is_warned = is_hidden_node(logger.name.replace(".", "/"))

    def note(self, took_ns: int) -> None:
        """Note a call, or several without a pause, that took SLOW_NS or more."""
        if not self._is_warned:
            self._is_warned = True
            name = f"{callback_name(self._callback)}{callback_place(self._callback)}"
            self._logger.warning(
                f"callback {name} of {self._what} held up the event loop for {took_ns / 1e6:.0f} ms, "
                "in which nothing else ran: make it async def, with await asyncio.to_thread(...) for the "
                "slow part (said once)"
            )


def watched(callback: Callable[..., Any], what: str, logger: Logger) -> Callable[..., Any]:
    """A timed version of the callback of `what`.

    In an async callback, each part between two awaits counts separately, because others run while it awaits.
    """
    note = SlowWatch(callback, what, logger).note
    if is_async(callback):

        @wraps(callback)
        @coroutine
        def call_async(*arguments: Any) -> Generator[Any, Any, Any]:
            # Done by hand in the way of `await`: a coroutine around it would cost twice as much.
            began_ns = monotonic_ns()
            try:
                work = callback(*arguments)
                if work.__class__ is not CoroutineType:
                    work = _wait_for(work)
                awaited = work.send(None)
            except StopIteration as end:
                return end.value
            finally:
                if (took_ns := monotonic_ns() - began_ns) >= SLOW_NS:
                    note(took_ns)
            return (yield from _go_on(work, awaited, note))

        mark_to_be_awaited(call_async)
        return call_async

    @wraps(callback)
    def call(*arguments: Any) -> Any:
        began_ns = monotonic_ns()
        try:
            return callback(*arguments)
        finally:
            if (took_ns := monotonic_ns() - began_ns) >= SLOW_NS:
                note(took_ns)

    return call


def timed_by_caller(
    callback: Callable[..., Any], what: str, logger: Logger
) -> tuple[Callable[..., Any], Callable[[int], object] | None]:
    """For a caller that times plain callbacks: the function to call, and a function that takes the
    nanoseconds of slow calls.

    For an async callback, it returns the result of `watched`, which needs no timing.
    """
    if is_async(callback):
        return watched(callback, what, logger), None
    return callback, SlowWatch(callback, what, logger).note


async def _wait_for(work: Awaitable[Any]) -> Any:
    """A Python coroutine for any awaitable."""
    return await work


def _go_on(
    work: Coroutine[Any, Any, Any], awaited: Any, note: Callable[[int], object]
) -> Generator[Any, Any, Any]:
    """Run a coroutine that has `awaited` an object to its end, and time each part of it."""
    while True:
        try:
            sent = yield awaited
        except BaseException as error:
            go_on = partial(work.throw, error)
        else:
            go_on = partial(work.send, sent)
        began_ns = monotonic_ns()
        try:
            awaited = go_on()
        except StopIteration as end:
            return end.value
        finally:
            del go_on  # with the error, it would be part of a cycle
            if (took_ns := monotonic_ns() - began_ns) >= SLOW_NS:
                note(took_ns)
