"""The daemon's log on stderr: as text or JSON lines, bounded whatever peers put into it.

Owns how a record looks, how many there may be, and the thread that writes them. So a pipe that is not read,
a stopped terminal or a slow disk holds up that thread and never the daemon. Must not know what is logged,
nor when.
"""

import json
import logging
import os
import select
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from errno import EBADF, EFBIG
from pathlib import Path
from typing import Any

from bus.base.counted import counted
from bus.base.printable import printable
from bus.errors import ConfigurationError
from bus.process.logfile import MOST_BYTES, empty, is_log, open_log

__all__ = ["LOG_FORMATS", "LOG_LEVELS", "set_up"]

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
"""ROS 2's severities; in upper case each is also a name that `logging` knows."""

LOG_FORMATS = ("text", "json")

_LONGEST_LINE = 1000
_LONGEST_TRACE = 16_000
_MOST_LINES = 100
_MOST_WAITING = 1000
"""Lines that may wait for the thread; more are left out, whatever their severity."""
_TELL_S = 1.0
"""How long after the last line the log says how many were left out; with another line it says so at once."""
_FLUSH_S = 2.0
"""How long busd waits at its end for unwritten lines."""
_TEXT = "[%(levelname)s] [%(created).9f] [%(name)s]: %(message)s"
_FIELDS = ("peer", "left_out")
"""Further fields of a record: the process (pid) it is about, and the number of lines left out."""


def set_up(level: str, form: str, path: Path | None = None) -> None:
    """Log to stderr from now on: from `level` on, one of LOG_LEVELS, in the LOG_FORMATS's `form`.

    May be called again, for other ones. `path`: of the log file, if stderr is one
    (`bus.process.logfile`); at the first call.
    """
    logging.addLevelName(logging.WARNING, "WARN")
    logging.addLevelName(logging.CRITICAL, "FATAL")
    root = logging.getLogger()
    handler = next((one for one in root.handlers if isinstance(one, _Lines)), None)
    if handler is None:
        handler = _Lines(_Stderr(path).write)
        root.handlers[:] = [handler]
    handler.setFormatter(_JsonLines() if form == "json" else _Text(_TEXT))
    root.setLevel(level.upper())


class _Lines(logging.Handler):
    """Gives lines to a thread, which calls `write` for each; and bounds them.

    Peers can cause short printable lines only, and not too many in a second. The limit of lines in a second
    does not apply to errors, and not to debug lines, which were asked for. A bounded number of lines waits.
    Lines left out are counted, and so are lines for which `write` raises OSError.
    """

    def __init__(self, write: Callable[[bytes], None]) -> None:
        super().__init__()
        self._write = write
        self._changed = threading.Condition()
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._is_writing = False
        self._is_failing = False
        self._is_closed = False
        self._left_out = 0
        self._second = 0
        self._lines = 0
        threading.Thread(target=self._run, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        with self._changed:
            if not self._has_room(record):
                self._left_out += 1
                if self._left_out == 1:
                    self._changed.notify_all()  # starts the time after which the log says so
                return
            self._write_left_out()
            self._put(record, 1)

    def flush(self) -> None:
        """Wait until all is written, but not for long: perhaps it never is."""
        with self._changed:
            self._write_left_out()
            self._changed.wait_for(lambda: not self._waiting and not self._is_writing, _FLUSH_S)

    def close(self) -> None:
        """End the thread when it has written the queued lines."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        super().close()

    def _has_room(self, record: logging.LogRecord) -> bool:
        if len(self._waiting) >= _MOST_WAITING:
            return False
        if not logging.DEBUG < record.levelno < logging.ERROR:
            return True
        if int(record.created) != self._second:
            self._second, self._lines = int(record.created), 0
        self._lines += 1
        return self._lines <= _MOST_LINES

    def _write_left_out(self) -> None:
        """Write a line that says how many were left out."""
        if self._left_out:
            text = f"({counted(self._left_out, 'line', 'was', 'were')} left out)"
            record = logging.LogRecord("busd", logging.WARNING, __file__, 0, text, (), None)
            record.left_out = self._left_out
            self._put(record, self._left_out)
            self._left_out = 0

    def _put(self, record: logging.LogRecord, number: int) -> None:
        """Queue `record`, which stands for `number` lines."""
        try:
            line = self.format(record)
        except Exception:
            self.handleError(record)
            return
        self._waiting.append((f"{line}\n".encode(errors="backslashreplace"), number))
        self._changed.notify_all()

    def _run(self) -> None:
        while (found := self._next()) is not None:
            line, number = found
            try:
                self._write(line)
                lost = 0
            except OSError:  # the pipe's reader has gone, or the disk is full
                lost = number
            with self._changed:
                self._is_writing = False
                self._is_failing = lost > 0
                self._left_out += lost
                self._changed.notify_all()

    def _next(self) -> tuple[bytes, int] | None:
        """Wait for the next line; None: there will be none."""
        with self._changed:
            while not self._waiting:
                if self._is_closed:
                    return None
                # If nothing can be written now, the next line is soon enough: each try costs something.
                has_to_report = self._left_out and not self._is_failing
                if not self._changed.wait(_TELL_S if has_to_report else None):
                    self._write_left_out()
            self._is_writing = True
            return self._waiting.popleft()


class _Stderr:
    """Writes to stderr, whatever that is, and waits as long as that takes. Turns over a log file that is
    full.

    `path`: of the log file, if stderr is one. `write` raises OSError if nothing can be written.
    """

    def __init__(self, path: Path | None) -> None:
        # Without a stderr, descriptor 2 may be anything by now.
        self._fd = -1 if sys.stderr is None else 2
        self._is_broken_off = False  # whether the end of the last line is missing
        self._path = path if path is not None and is_log(self._fd) else None
        if self._path is not None and not _is_at(self._fd, self._path):
            self._go_on(MOST_BYTES)  # it is in memory, or was removed: try again now, as a restart does

    def write(self, line: bytes) -> None:
        try:
            self._write(line)
        except OSError as error:
            if error.errno != EFBIG or self._path is None:
                raise
            self._go_on(os.fstat(self._fd).st_size)  # this process may write no larger file
            self._write(line)
        if self._path is not None and os.fstat(self._fd).st_size >= MOST_BYTES:
            self._go_on(MOST_BYTES)

    def _write(self, line: bytes) -> None:
        if self._fd < 0:
            raise OSError(EBADF, os.strerror(EBADF))
        rest = b"\n" + line if self._is_broken_off else line
        while rest:
            try:
                rest = rest[os.write(self._fd, rest) :]
                self._is_broken_off = bool(rest)
            except BlockingIOError:  # another process that has it made it non-blocking
                ready = select.poll()
                ready.register(self._fd, select.POLLOUT)
                ready.poll()

    def _go_on(self, most_bytes: int) -> None:
        """Go on in the file at the path. If it can't be opened, go on in this one from its beginning.

        One that has `most_bytes` is full.
        """
        assert self._path is not None
        self._is_broken_off = False
        try:
            fd = open_log(self._path, most_bytes)
        except ConfigurationError:
            with suppress(OSError):
                empty(self._fd)
        else:
            os.dup2(fd, self._fd)
            os.close(fd)


def _is_at(fd: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(fd), path.lstat())
    except OSError:
        return False


class _Text(logging.Formatter):
    """ROS 2's format."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        record.message = _message(record)
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:
        return printable(super().formatException(ei)[-_LONGEST_TRACE:])


class _JsonLines(logging.Formatter):
    """One object a line; a traceback is a text in it."""

    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="microseconds"),
            "severity": record.levelname,
            "name": record.name,
            "message": _message(record),
        }
        line |= {name: value for name in _FIELDS if (value := getattr(record, name, None)) is not None}
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)[-_LONGEST_TRACE:]
        return json.dumps(line)  # in ASCII: a lone surrogate is no UTF-8


def _message(record: logging.LogRecord) -> str:
    """Short, on one line, and without control characters."""
    return printable(record.getMessage()[:_LONGEST_LINE], keep="")[:_LONGEST_LINE]
