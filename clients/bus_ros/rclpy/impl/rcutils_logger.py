"""The logger of a node, with rclpy's filters and its rules for them.

Owns `once`, `skip_first` and `throttle_*`; their state belongs to the calling line of the program.
`bus.logger` has levels, the format and outputs.
"""

import logging
import time
from collections.abc import Mapping
from functools import cache
from types import FrameType
from typing import Any, ClassVar, cast

from bus.logger import TOP_NAME, Filters, Logger, Severity, set_default_level
from bus_ros.rclpy.impl.logging_severity import LoggingSeverity

__all__ = ["LoggingFilter", "Once", "RcutilsLogger", "SkipFirst", "Throttle"]


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
    """Passes at most one call in `throttle_duration_sec`, by the clock `throttle_time_source_type`."""

    params: ClassVar[dict[str, Any]] = {
        "throttle_duration_sec": None,
        "throttle_time_source_type": "RCUTILS_STEADY_TIME",
    }

    def __init__(self, keywords: Mapping[str, Any]) -> None:
        self._period_ns = int(keywords["throttle_duration_sec"] * 1e9)
        self._last_ns: int | None = None
        clock = keywords.get("throttle_time_source_type") or "RCUTILS_STEADY_TIME"
        if clock == "RCUTILS_STEADY_TIME":
            self._clock = None
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

    __slots__ = ("filters", "keywords", "names", "severity")

    def __init__(self, severity: int, keywords: Mapping[str, Any]) -> None:
        self.severity = severity
        self.keywords = dict(keywords)
        self.names = _detect(keywords)
        self.filters = [_FILTERS[name](keywords) for name in self.names]


class RcutilsLogger(Logger):
    """A named logger.

    `debug`, `info`, `warning` (`warn`), `error`, `fatal` and `log` return whether they logged. One place must
    call with the same severity and filters each time; otherwise ValueError. An unknown keyword is a
    TypeError. Neither is checked if the severity is not enabled.
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
        """Log this severity and above, here and in children; UNSET: as the parent.

        Raises ValueError for an invalid severity.
        """
        if self.name:
            super().set_level(_native(level))
        else:
            set_default_level(_native(level))

    def get_effective_level(self) -> LoggingSeverity:  # type: ignore[override]  # another enum, same numbers
        """The lowest severity that is logged."""
        return LoggingSeverity(super().get_effective_level())

    def log(self, message: object, severity: LoggingSeverity | Severity | int | str, **filters: Any) -> bool:
        """Log a message; `name=` uses another logger."""
        other = filters.pop("name", self.name)
        level = Severity[severity.upper()] if isinstance(severity, str) else Severity(severity)
        logger = self if other == self.name else _shared(other)
        return logger._logger.isEnabledFor(level) and logger._log(level, message, cast(Filters, filters))

    def _is_wanted(self, frame: FrameType, severity: Severity, filters: Filters) -> bool:
        code = frame.f_code
        # f_lasti distinguishes two calls on one line.
        key = (code.co_filename, code.co_firstlineno, frame.f_lasti)
        site = self._sites.get(key)
        if site is None:
            site = self._sites[key] = _CallSite(severity, filters)
        elif site.severity != severity:
            raise ValueError("Logger severity cannot be changed between calls.")
        elif site.keywords != filters:
            if _detect(filters) != site.names:
                raise ValueError("Requested logging filters cannot be changed between calls.")
            if any(filters.get(key) != site.keywords.get(key) for key in _keywords_of(site.names)):
                raise ValueError("Logging filter parameters cannot be changed between calls.")
        return all(one.should_log() for one in site.filters)


def _detect(keywords: Mapping[str, Any]) -> list[str]:
    """The names of the filters for the keywords; raises TypeError for an unknown or missing keyword."""
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
