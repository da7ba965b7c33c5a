"""Warnings about actions of other processes: a bounded number in a second, and the count of further ones.

Another process can make thousands of endpoints that don't match ours. Each of them causes a line in the log,
and perhaps a request to busd. Owns the bounds, one for all nodes of an event loop. Must not know the texts of
warnings.
"""

import asyncio
from collections.abc import Callable
from weakref import WeakKeyDictionary

from bus.base.printable import printable
from bus.logger import Logger, get_logger

__all__ = ["inform", "is_worth_asking", "warn"]

_MOST = 20
_PERIOD_S = 1.0

_Counts = WeakKeyDictionary[asyncio.AbstractEventLoop, int]
"""Numbers in the present period, by event loop."""

_lines: _Counts = WeakKeyDictionary()
_notes: _Counts = WeakKeyDictionary()
_questions: _Counts = WeakKeyDictionary()


def warn(logger: Logger, text: str) -> None:
    """Log a warning that contains another process's text, as one line, unless there were too many.

    Must be called on the event loop.
    """
    if _is_within_bounds(_lines, _warn_left_out):
        logger.warning(printable(text, keep=""))


def inform(logger: Logger, text: str) -> None:
    """As `warn`, for an event that is no fault."""
    if _is_within_bounds(_notes, lambda number: _log_notes_left_out(logger, number)):
        logger.info(printable(text, keep=""))


def is_worth_asking() -> bool:
    """Whether to request more from busd about an action of another process: not after too many in a second.

    Must be called on the event loop, before each request.
    """
    return _is_within_bounds(_questions, _ignore)


def _is_within_bounds(counts: _Counts, at_end: Callable[[int], None]) -> bool:
    """Count one more. The first begins a period; at its end, `at_end` gets the number."""
    loop = asyncio.get_running_loop()
    number = counts[loop] = counts.get(loop, 0) + 1
    if number == 1:
        loop.call_later(_PERIOD_S, lambda: at_end(counts.pop(loop)))
    return number <= _MOST


def _ignore(number: int) -> None:
    """Does nothing: requests left out are not reported."""


def _log_notes_left_out(logger: Logger, number: int) -> None:
    if number > _MOST:
        logger.info(f"{number - _MOST} more lines like these were left out")


def _warn_left_out(number: int) -> None:
    if number > _MOST:
        get_logger("bus").warning(f"{number - _MOST} more warnings about other nodes were left out")
