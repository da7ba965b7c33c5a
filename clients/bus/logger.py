"""ROS's console log on top of `logging`: `[INFO] [1635316982.775247978] [minimal_publisher]: text` on stderr.

Owns the severities, the format and its environment variables (rcutils/logging.c), the filters `once`,
`skip_first` and `throttle_duration_sec` (rclpy/impl/rcutils_logger.py), and the hook that feeds /rosout. Must
not know nodes or topics. It does not change the root logger or foreign handlers: all loggers made here are
children of `logging.getLogger(TOP_NAME)`, which does not propagate.
"""

import logging
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Mapping
from enum import IntEnum
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO, TypeAlias, TypedDict, Unpack

from bus.base.printable import printable
from bus.errors import ConfigurationError

if TYPE_CHECKING:  # its import would load msgspec
    from bus.process.ros_args import Arguments

__all__ = [
    "TOP_NAME",
    "ConsoleHandler",
    "Filters",
    "LogEntry",
    "Logger",
    "Severity",
    "Sink",
    "configure",
    "enable_console",
    "get_logger",
    "set_default_level",
]

TOP_NAME = "bus.nodes"
"""The name in `logging` of the parent of all loggers made here."""


class Severity(IntEnum):
    """ROS's severities, with the numbers of `logging` and rcl_interfaces/msg/Log.

    For example:

        node.get_logger().set_level(bus.Severity.DEBUG)
    """

    UNSET = 0
    """The parent's level."""
    DEBUG = 10
    """Details that help to find a fault."""
    INFO = 20
    """Normal events; the lowest severity that is logged by default."""
    WARN = 30
    """Possible faults."""
    ERROR = 40
    """Failures."""
    FATAL = 50
    """Failures that end the program."""


class LogEntry(NamedTuple):
    """One record for a sink, with the fields of rcl_interfaces/msg/Log."""

    severity: int
    stamp_ns: int
    name: str
    text: str
    file: str
    function: str
    line: int


Sink: TypeAlias = Callable[[LogEntry], None]


class Filters(TypedDict, total=False):
    """Keywords of every logging call. Each calling place in the program has its own filter."""

    once: bool
    """Log only the first call."""
    skip_first: bool
    """Log all calls but the first."""
    throttle_duration_sec: float
    """Log no more often than this."""


class Logger:
    """A named logger. Dots in the name make a tree: a child without a level inherits its parent's level.

    Made by `Node.get_logger` and `get_logger`; may be used from any thread. The methods for each severity
    take any object, logged as its str(), and return whether it was logged. They have filters, kept for each
    calling place in the program: `once=True` logs the first call only, `skip_first=True` all others,
    `throttle_duration_sec=1.0` at most one in that many seconds. Filters only apply if the severity is
    enabled.

        node.get_logger().warning("slow", throttle_duration_sec=1.0)
    """

    __slots__ = ("_filters", "_logger", "name")

    def __init__(self, name: str) -> None:
        self.name = name
        """Its name, without `bus.nodes`, its parent's name in `logging`."""
        self._logger = logging.getLogger(f"{TOP_NAME}.{name}")
        self._filters: dict[_CallSite, _FilterState] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name!r} {self.get_effective_level().name}>"

    def debug(self, message: object, **filters: Unpack[Filters]) -> bool:
        """Log `message` as DEBUG; returns whether it was logged."""
        return self._logger.isEnabledFor(Severity.DEBUG) and self._log(Severity.DEBUG, message, filters)

    def info(self, message: object, **filters: Unpack[Filters]) -> bool:
        """Log `message` as INFO; returns whether it was logged."""
        return self._logger.isEnabledFor(Severity.INFO) and self._log(Severity.INFO, message, filters)

    def warning(self, message: object, **filters: Unpack[Filters]) -> bool:
        """Log `message` as WARN; returns whether it was logged."""
        return self._logger.isEnabledFor(Severity.WARN) and self._log(Severity.WARN, message, filters)

    def error(self, message: object, **filters: Unpack[Filters]) -> bool:
        """Log `message` as ERROR; returns whether it was logged."""
        return self._logger.isEnabledFor(Severity.ERROR) and self._log(Severity.ERROR, message, filters)

    def fatal(self, message: object, **filters: Unpack[Filters]) -> bool:
        """Log `message` as FATAL; returns whether it was logged."""
        return self._logger.isEnabledFor(Severity.FATAL) and self._log(Severity.FATAL, message, filters)

    warn = warning
    critical = fatal

    def log(self, message: object, severity: Severity | int | str, **filters: Unpack[Filters]) -> bool:
        """Log `message` as `severity`, which may be given by name; returns whether it was logged.

        Raises ConfigurationError for an unknown severity.
        """
        level = _severity(severity)
        return self._logger.isEnabledFor(level) and self._log(level, message, filters)

    def set_level(self, level: Severity | int | str) -> None:
        """Log this severity and above, here and in children; UNSET = as the parent.

        Raises ConfigurationError for an unknown severity.
        """
        self._logger.setLevel(_severity(level))

    def get_effective_level(self) -> Severity:
        """The lowest severity that is logged."""
        level = self._logger.getEffectiveLevel()
        return min((one for one in Severity if one >= level), default=Severity.FATAL)

    def is_enabled_for(self, severity: Severity | int | str) -> bool:
        """Whether that severity would be logged."""
        return self._logger.isEnabledFor(_severity(severity))

    def get_child(self, name: str) -> "Logger":
        """The logger `<this name>.<name>`. Raises ConfigurationError for an empty name."""
        if not name:
            raise ConfigurationError("Child logger name must not be empty.")
        return get_logger(f"{self.name}.{name}")

    def add_sink(self, sink: Sink) -> None:
        """Also hand every entry of this logger and its children to `sink`, in the thread that logs.

        An entry has `severity`, `stamp_ns` (wall clock), `name`, `text`, `file`, `function` and `line`. The
        sink does not receive entries that it logs itself. An exception in the sink is reported on stderr.
        """
        self._logger.addHandler(_SinkHandler(sink))

    def remove_sink(self, sink: Sink) -> None:
        """Undo `add_sink`; has no effect if the sink was not added."""
        for handler in self._logger.handlers[:]:
            if isinstance(handler, _SinkHandler) and handler.sink == sink:
                self._logger.removeHandler(handler)
                handler.close()

    def _log(self, severity: Severity, message: object, filters: Filters) -> bool:
        frame = sys._getframe(2)
        if not self._is_wanted(frame, severity, filters):
            return False
        self._write(severity, message, frame)
        return True

    def _write(self, severity: Severity, message: object, frame: FrameType) -> None:
        self._logger.handle(_Record(self.name, severity, frame, str(message)))

    def _is_wanted(self, frame: FrameType, severity: Severity, filters: Filters) -> bool:
        """Whether the filters accept this call; loggers with other filters override this."""
        return not filters or self._passes(frame, **filters)

    def _passes(
        self,
        frame: FrameType,
        once: bool = False,
        skip_first: bool = False,
        throttle_duration_sec: float = 0.0,
    ) -> bool:
        code = frame.f_code
        # f_lasti distinguishes two calls on one line.
        site = (code.co_filename, code.co_name, frame.f_lineno, frame.f_lasti)
        state = self._filters.get(site)
        if state is None:
            state = self._filters[site] = _FilterState()
        # In rclpy's order: a filter sees only the calls that earlier filters accept.
        if throttle_duration_sec:
            now_s = time.monotonic()
            if state.last_s is not None and now_s < state.last_s + throttle_duration_sec:
                return False
            state.last_s = now_s
        if skip_first and not state.skipped:
            state.skipped = True
            return False
        if once:
            if state.logged:
                return False
            state.logged = True
        return True


def get_logger(name: str) -> Logger:
    """A logger of that name, for code that has no node; its lines go to stderr alone.

    Levels belong to the name; the state of filters to the object. Raises ConfigurationError for an
    empty name.

        bus.get_logger("planner").info("ready")
    """
    if not name:
        raise ConfigurationError("Logger name must not be empty.")
    return Logger(name)


def set_default_level(level: Severity | int | str) -> None:
    """Set the level of all loggers without a level; UNSET restores INFO."""
    _TOP.setLevel(_severity(level) or Severity.INFO)


def configure(arguments: "Arguments") -> None:
    """Apply the log options of a command line, and warn of rules outside of its ROS arguments, once."""
    for level in arguments.log_levels:
        if level.logger:
            get_logger(level.logger).set_level(level.severity)
        else:
            set_default_level(level.severity)
    if not arguments.log_to_console:
        enable_console(False)
    for rule in arguments.deprecated:
        if rule not in _warned_of:
            _warned_of.add(rule)
            get_logger("bus").warning(
                f"found remap rule '{rule}'; this syntax is deprecated, use --ros-args -r {rule}"
            )


def enable_console(enabled: bool) -> None:
    """Set whether logs are written to stderr; sinks get them in both cases."""
    _CONSOLE.setLevel(logging.NOTSET if enabled else logging.CRITICAL + 1)


class ConsoleHandler(logging.Handler):
    """Writes one line for each record to stderr, at once and in one write.

    $RCUTILS_CONSOLE_OUTPUT_FORMAT is a template with {severity}, {time}, {name}, {message}, {file_name},
    {line_number}, {function_name} and {time_as_nanoseconds}. Lines are coloured on a terminal, and elsewhere
    if $RCUTILS_COLORIZED_OUTPUT is 1, but never if that is 0 or $NO_COLOR is set. Control characters are
    escaped, except newlines, tabs, and colours, which end with the line. If the stream can't be written to,
    the line is lost. If it is a pipe without a reader, SIGPIPE ends programs of `bus.run` and `bus.connect`.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        super().__init__()
        self._environ = environ
        self._template: str | None = None
        self._stream: TextIO | None = None
        self._coloured = False

    def handle(self, record: logging.LogRecord) -> bool:
        # As in Python 3.13: in earlier versions, Ctrl-C may come after the lock was taken and before its
        # release is certain. Then every other thread that logs waits for ever.
        kept: Any = self.filter(record)
        if kept:
            assert self.lock is not None
            with self.lock:
                self.emit(kept if isinstance(kept, logging.LogRecord) else record)
        return bool(kept)

    def emit(self, record: logging.LogRecord) -> None:
        stream: TextIO | None = sys.stderr
        if stream is None:  # a process without a terminal may have none
            return
        try:
            if stream is not self._stream:
                self._coloured = self._wants_colour(stream)
                self._stream = stream
            stream.write(self.format(record) + "\n")
            stream.flush()
        except (OSError, ValueError):  # a broken pipe, a full disk, a closed file
            pass

    def format(self, record: logging.LogRecord) -> str:
        if self._template is None:
            # Read late, because scripts set the variable in their first lines, after the imports.
            self._template = _template(self._environ.get("RCUTILS_CONSOLE_OUTPUT_FORMAT") or _DEFAULT_FORMAT)
        severity = _severity_of(record)
        stamp_ns = _stamp_ns(record)
        line = self._template % {
            "severity": severity.name,
            "time": f"{stamp_ns // 1_000_000_000}.{stamp_ns % 1_000_000_000:09d}",
            "time_as_nanoseconds": stamp_ns,
            "name": record.name,
            "message": record.getMessage(),
            "file_name": record.pathname,
            "line_number": record.lineno,
            "function_name": record.funcName,
        }
        if not line.isprintable():
            line = _shown(line)
        colour = _COLOURS.get(severity) if self._coloured else None
        return line if colour is None else f"\x1b[{colour}m{line}{_END_OF_COLOUR}"

    def _wants_colour(self, stream: TextIO) -> bool:
        choice = self._environ.get("RCUTILS_COLORIZED_OUTPUT")
        if choice == "0" or self._environ.get("NO_COLOR"):
            return False
        return choice == "1" or bool(getattr(stream, "isatty", bool)())  # a replacement of stderr may lack it


_DEFAULT_FORMAT = "[{severity}] [{time}] [{name}]: {message}"
_TOKEN = re.compile(
    r"\{(severity|time|name|message|file_name|line_number|function_name|time_as_nanoseconds)\}"
)
_END_OF_COLOUR = "\x1b[0m"
_ENDS_OF_COLOUR = (_END_OF_COLOUR, "\x1b[m")
_COLOURING = "(\x1b\\[[0-9;:]*m)"
"""A terminal's SGR sequence, which only changes the look of text."""
_COLOURS = {Severity.DEBUG: 32, Severity.WARN: 33, Severity.ERROR: 31, Severity.FATAL: 31}

_CallSite: TypeAlias = tuple[str, str, int, int]


class _FilterState:
    __slots__ = ("last_s", "logged", "skipped")

    def __init__(self) -> None:
        self.last_s: float | None = None
        self.skipped = False
        self.logged = False


class _Record(logging.LogRecord):
    """A record with an exact stamp; `created` is a float of seconds, too coarse for nanoseconds."""

    def __init__(self, name: str, severity: Severity, frame: FrameType, text: str) -> None:
        code = frame.f_code
        super().__init__(name, severity, code.co_filename, frame.f_lineno, text, (), None, code.co_name)
        self.severity = severity
        self.stamp_ns = time.time_ns()


class _SinkHandler(logging.Handler):
    def __init__(self, sink: Sink) -> None:
        super().__init__()
        self.sink = sink
        self._inside: set[int] = set()

    def handle(self, record: logging.LogRecord) -> bool:
        # Without the handler's lock: a sink takes further locks, and threads that have these may be logging.
        thread = threading.get_ident()
        if thread in self._inside:
            return False
        self._inside.add(thread)
        try:
            self.sink(_entry(record))
        except Exception:
            self.handleError(record)
        finally:
            self._inside.discard(thread)
        return True


def _entry(record: logging.LogRecord) -> LogEntry:
    return LogEntry(
        int(_severity_of(record)),
        _stamp_ns(record),
        record.name,
        record.getMessage(),
        record.pathname,
        record.funcName or "",
        record.lineno,
    )


def _stamp_ns(record: logging.LogRecord) -> int:
    return record.stamp_ns if isinstance(record, _Record) else int(record.created * 1e9)


def _severity_of(record: logging.LogRecord) -> Severity:
    if isinstance(record, _Record):
        return record.severity
    # Code that uses our loggers through `logging` may pass any number.
    return max((one for one in Severity if one <= record.levelno), default=Severity.DEBUG)


def _severity(value: Severity | int | str) -> Severity:
    try:
        return Severity[value.upper()] if isinstance(value, str) else Severity(value)
    except (KeyError, ValueError):
        allowed = ", ".join(f"{one.name} {one.value}" for one in Severity)
        raise ConfigurationError(f"{value!r} is no severity ({allowed})") from None


def _template(text: str) -> str:
    """The format with {tokens} as a template for `%`; all other text stays as it is."""
    return _TOKEN.sub(r"%(\1)s", text.replace("%", "%%"))


def _shown(line: str) -> str:
    """`line` in a form safe for a terminal, with text from any source.

    Colours stay, because programs use them.
    """
    parts = re.split(_COLOURING, line)  # text, colour, text ...
    parts[::2] = map(printable, parts[::2])
    if len(parts) > 1 and parts[-2] not in _ENDS_OF_COLOUR:
        parts.append(_END_OF_COLOUR)
    return "".join(parts)


_warned_of: set[str] = set()
"""The deprecated remap rules of command lines."""
_TOP = logging.getLogger(TOP_NAME)
_CONSOLE = ConsoleHandler()
_TOP.addHandler(_CONSOLE)
_TOP.setLevel(Severity.INFO)
_TOP.propagate = False
