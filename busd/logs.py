"""The daemon's log on stderr: as text or JSON lines, bounded whatever peers put into it.

Owns how a record looks and how many there may be. Must not know what is logged, nor when.
"""

import json
import logging
import sys
from datetime import UTC, datetime

__all__ = ["LOG_FORMATS", "LOG_LEVELS", "set_up"]

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
"""ROS 2's severities; in upper case each is also a name that `logging` knows."""

LOG_FORMATS = ("text", "json")

_LONGEST_LINE = 1000
_LONGEST_TRACE = 16_000
_MOST_LINES = 100
_TEXT = "[%(levelname)s] [%(created).9f] [%(name)s]: %(message)s"
_FIELDS = ("peer", "left_out")
"""What a record may say beside its message: of which process (pid) it is, and `_Bounds`'s count."""


def set_up(level: str, form: str) -> None:
    """Log to stderr from now on: from `level` on, one of LOG_LEVELS, in the LOG_FORMATS's `form`.

    May be called again, for other ones.
    """
    logging.addLevelName(logging.WARNING, "WARN")
    logging.addLevelName(logging.CRITICAL, "FATAL")
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_Bounds())
    handler.setFormatter(_JsonLines() if form == "json" else _Text(_TEXT))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


class _Bounds(logging.Filter):
    """Bounds what peers can make of the log: short printable lines, and not too many in a second.

    Errors always come through, and debug lines are for somebody who wants all of them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._second = 0
        self._lines = 0

    def filter(self, record: logging.LogRecord) -> bool:
        left_out = 0
        if logging.DEBUG < record.levelno < logging.ERROR:
            if int(record.created) != self._second:
                left_out = self._lines - _MOST_LINES
                self._second, self._lines = int(record.created), 0
            self._lines += 1
            if self._lines > _MOST_LINES:
                return False
        text = record.getMessage()[:_LONGEST_LINE]
        if not text.isprintable():
            text = "".join(c if c.isprintable() else "?" for c in text)
        record.msg = text
        record.args = ()
        if left_out > 0:
            record.left_out = left_out
        return True


class _Text(logging.Formatter):
    """ROS 2's format."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        left_out = getattr(record, "left_out", 0)
        return super().formatMessage(record) + (f" ({left_out} lines were left out)" if left_out else "")


class _JsonLines(logging.Formatter):
    """One object a line; a traceback is a text in it."""

    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="microseconds"),
            "severity": record.levelname,
            "name": record.name,
            "message": record.getMessage(),
        }
        line |= {name: value for name in _FIELDS if (value := getattr(record, name, None)) is not None}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)[-_LONGEST_TRACE:]
        return json.dumps(line)  # in ASCII: a lone surrogate is no UTF-8
