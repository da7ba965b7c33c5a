"""The logger of a node, with rclpy's filters and its rules for them.

Owns `once`, `skip_first` and `throttle_*`; their state belongs to the calling line of the program.
`bus.logger` has levels, the format and outputs.
"""

import logging
import sys
import time
from collections.abc import Mapping
from functools import cache
from types import FrameType
from typing import Any, ClassVar

from bus.logger import TOP_NAME, Filters, Logger, Severity, set_default_level
from bus_ros.rclpy.impl.logging_severity import LoggingSeverity

__all__ = ["LoggingFilter", "Once", "RcutilsLogger", "SkipFirst", "Throttle", "level_of"]

_EVERYTHING = 1
"""The number in `logging` for the level UNSET of the root logger: there, 0 is the level of a parent."""


class LoggingFilter:
    """Base of the filters: the state for one calling place.

    `params` are its keywords with their defaults; None: the keyword is required.
    """

    params: ClassVar[dict[str, Any]] = {}

    def __init__(self, keywords: Mapping[str, Any]) -> None:
        """Raises ValueError for an invalid value of a keyword."""

    def should_log(self) -> bool:
        """Whether the present call is logged."""
        return True


class Throttle(LoggingFilter):
    """Passes at most one call in `throttle_duration_sec`, by the clock `throttle_time_source_type`.

    A clock of the program counts from its zero: a simulation's first call passes only after the duration.
    """

    params: ClassVar[dict[str, Any]] = {
        "throttle_duration_sec": None,
        "throttle_time_source_type": "RCUTILS_STEADY_TIME",
    }

    def __init__(self, keywords: Mapping[str, Any]) -> None:
        self._period_ns = int(keywords["throttle_duration_sec"] * 1e9)
        self._last_ns: int | None = 0
        clock = keywords.get("throttle_time_source_type") or "RCUTILS_STEADY_TIME"
        if clock == "RCUTILS_STEADY_TIME":
            self._clock, self._last_ns = None, None
            return
        # Late: most loggers are throttled by the steady clock, or not at all.
        from bus_ros.rclpy.clock import Clock

        if not isinstance(clock, Clock):
            raise ValueError(f'Received throttle_time_source_type of "{clock}" is not a clock instance')
        self._clock = clock

    def should_log(self) -> bool:
        now_ns = time.monotonic_ns() if self._clock is None else self._clock.now().nanoseconds
        # If the clock was set back, the filter starts again.
        if self._last_ns is not None and 0 <= now_ns - self._last_ns < self._period_ns:
            return False
        self._last_ns = now_ns
        return True


class SkipFirst(LoggingFilter):
    """Passes all calls except the first."""

    params: ClassVar[dict[str, Any]] = {"skip_first": None}

    def __init__(self, keywords: Mapping[str, Any]) -> None:
        self._has_skipped = False

    def should_log(self) -> bool:
        has_skipped, self._has_skipped = self._has_skipped, True
        return has_skipped


class Once(LoggingFilter):
    """Passes only the first call."""

    params: ClassVar[dict[str, Any]] = {"once": None}

    def __init__(self, keywords: Mapping[str, Any]) -> None:
        self._has_logged = False

    def should_log(self) -> bool:
        has_logged, self._has_logged = self._has_logged, True
        return not has_logged


# Filters are applied in this order; each gets only calls that the previous ones pass.
_FILTERS: dict[str, type[LoggingFilter]] = {"throttle": Throttle, "skip_first": SkipFirst, "once": Once}
_KEYWORDS = [keyword for kind in _FILTERS.values() for keyword in kind.params]


class _CallSite:
    """A calling place: the arguments of its first call, and its filters."""

    __slots__ = ("filters", "keywords", "logger", "names", "severity")

    def __init__(self, severity: int, logger: str, keywords: Mapping[str, Any]) -> None:
        self.severity = severity
        self.logger = logger
        self.keywords = dict(keywords)
        self.names = _detect(keywords)
        self.filters = [_FILTERS[name](keywords) for name in self.names]


class RcutilsLogger(Logger):
    """A named logger.

    `debug`, `info`, `warning` (`warn`), `error`, `fatal` and `log` return whether they logged; `name=` logs
    under another name. One place must call with the same severity, name and filters each time; otherwise
    ValueError. An unknown keyword is a TypeError. Neither is checked if the severity is not enabled.
    """

    __slots__ = ("_sites",)

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        if not name:
            self._logger = logging.getLogger(TOP_NAME)  # the parent of all
        self._sites: dict[tuple[str, int, int], _CallSite] = {}

    def get_child(self, name: str) -> "RcutilsLogger":
        """The logger `<this name>.<name>`; raises ValueError for an empty name."""
        if not name:
            raise ValueError("Child logger name must not be empty.")
        return RcutilsLogger(f"{self.name}.{name}" if self.name else name)

    def set_level(self, level: LoggingSeverity | Severity | int | str) -> None:
        """Log this severity and above, here and in children; UNSET: as the parent, and the root logger all.

        Raises ValueError for an invalid severity.
        """
        if self.name:
            super().set_level(_native(level))
            return
        set_default_level(_native(level))
        if level == 0 or (isinstance(level, str) and level.upper() == "UNSET"):
            self._logger.setLevel(_EVERYTHING)

    def get_effective_level(self) -> LoggingSeverity:  # type: ignore[override]  # another enum, same numbers
        """The lowest severity that is logged; UNSET if the root logger is UNSET and no other has a level."""
        if self._logger.getEffectiveLevel() == _EVERYTHING:
            return LoggingSeverity.UNSET
        return LoggingSeverity(super().get_effective_level())

    def log(self, message: object, severity: LoggingSeverity | Severity | int | str, **filters: Any) -> bool:
        """Log a message with that severity."""
        level = Severity[severity.upper()] if isinstance(severity, str) else Severity(severity)
        return self._logger.isEnabledFor(level) and self._log(level, message, filters)  # type: ignore[arg-type]

    def _log(self, severity: Severity, message: object, filters: Filters) -> bool:
        keywords: dict[str, Any] = dict(filters)
        name = keywords.pop("name", self.name)
        frame = sys._getframe(2)
        if not self._passes_at(frame, severity, name, keywords):
            return False
        logger = self if name == self.name else _shared(name)
        if not logger._logger.isEnabledFor(severity):
            return False
        logger._write(severity, message, frame)
        return True

    def _passes_at(self, frame: FrameType, severity: Severity, name: str, filters: dict[str, Any]) -> bool:
        code = frame.f_code
        # f_lasti distinguishes two calls on one line.
        key = (code.co_filename, code.co_firstlineno, frame.f_lasti)
        site = self._sites.get(key)
        if site is None:
            site = self._sites[key] = _CallSite(severity, name, filters)
        elif site.severity != severity:
            raise ValueError("Logger severity cannot be changed between calls.")
        elif site.logger != name:
            raise ValueError("Logger name cannot be changed between calls.")
        elif site.keywords != filters:
            if _detect(filters) != site.names:
                raise ValueError("Requested logging filters cannot be changed between calls.")
            if any(filters.get(key) != site.keywords.get(key) for key in _keywords_of(site.names)):
                raise ValueError("Logging filter parameters cannot be changed between calls.")
        return all(one.should_log() for one in site.filters)


def level_of(logger: RcutilsLogger) -> LoggingSeverity:
    """The level set for exactly this logger; UNSET if there is none."""
    level = logger._logger.level
    return LoggingSeverity.UNSET if level == _EVERYTHING else LoggingSeverity(level)


def _detect(keywords: Mapping[str, Any]) -> list[str]:
    """The names of the filters for the keywords; raises TypeError for an unknown or missing keyword."""
    if "severity" in keywords:
        raise TypeError("RcutilsLogger.log() got multiple values for argument 'severity'")
    for keyword in keywords:
        if keyword not in _KEYWORDS:
            raise TypeError(
                f'parameter "{keyword}" is not one of the recognized logging options "{_KEYWORDS}"'
            )
    found = [name for name, kind in _FILTERS.items() if any(keywords.get(one) for one in kind.params)]
    for name in found:
        for keyword, default in _FILTERS[name].params.items():
            if default is None and keyword not in keywords:
                raise TypeError(
                    f'required parameter "{keyword}" not specified but is required'
                    f' for the the logging filter "{name}"'
                )
    return found


def _keywords_of(names: list[str]) -> list[str]:
    return [keyword for name in names for keyword in _FILTERS[name].params]


def _native(level: LoggingSeverity | Severity | int | str) -> int | str:
    return level if isinstance(level, str) else int(level)


@cache
def _shared(name: str) -> RcutilsLogger:
    return RcutilsLogger(name)
