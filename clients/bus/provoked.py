"""Warnings about what other processes do: at most so many in a second, and how many more there were.

Others can make thousands of endpoints that don't match ours, and each is worth a line, and maybe a question
to busd. Owns the bounds, which are of all nodes of an event loop together. Must not know what is warned of.
"""

import asyncio
from weakref import WeakKeyDictionary

from bus.logger import Logger, get_logger
from bus.printable import printable

__all__ = ["is_worth_asking", "warn"]

_MOST_LINES = 20
_PERIOD_S = 1.0

_lines: WeakKeyDictionary[asyncio.AbstractEventLoop, int] = WeakKeyDictionary()
"""How many warnings there were in the period that has begun, by event loop."""

_questions: WeakKeyDictionary[asyncio.AbstractEventLoop, int] = WeakKeyDictionary()
"""And how many questions."""


def warn(logger: Logger, text: str) -> None:
    """Log a warning with words of others in it as one line, unless there were too many.

    To be called on the event loop.
    """
    loop = asyncio.get_running_loop()
    number = _lines.get(loop, 0) + 1
    _lines[loop] = number
    if number == 1:
        loop.call_later(_PERIOD_S, _end_period, loop)
    if number <= _MOST_LINES:
        logger.warning(printable(text, keep=""))


def is_worth_asking() -> bool:
    """Whether to ask busd more about what another process did: no, after too many times in a second.

    To be called on the event loop, before each question.
    """
    loop = asyncio.get_running_loop()
    number = _questions.get(loop, 0) + 1
    _questions[loop] = number
    if number == 1:
        loop.call_later(_PERIOD_S, _questions.pop, loop, None)
    return number <= _MOST_LINES


def _end_period(loop: asyncio.AbstractEventLoop) -> None:
    left_out = _lines.pop(loop) - _MOST_LINES
    if left_out > 0:
        get_logger("bus").warning(f"{left_out} more warnings about other nodes were left out")
