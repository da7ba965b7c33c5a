"""Log lines that a program can cause as often as it likes: the log has each of them only from time to time.

Owns when a line is a repetition. Must not know what the lines are about.
"""

import logging
from time import monotonic_ns

__all__ = ["Repetitions"]

_AGAIN_NS = 10_000_000_000

_log = logging.getLogger("busd")


class Repetitions:
    """Logs lines; a line that repeats the line before within ten seconds gets the level DEBUG."""

    def __init__(self) -> None:
        self._last = ""
        self._last_ns = 0

    def log(self, level: int, text: str) -> None:
        """Log `text` with `level`, if it is no repetition."""
        now_ns = monotonic_ns()
        is_repeated = text == self._last and now_ns - self._last_ns < _AGAIN_NS
        self._last, self._last_ns = text, now_ns
        _log.log(logging.DEBUG if is_repeated else level, "%s", text)
