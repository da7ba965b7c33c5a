"""Loggers by name and their levels, as rclpy.logging. `bus.logger` has lines, levels and handlers."""

import logging
import os
from pathlib import Path

from bus.logger import TOP_NAME, Severity, set_default_level
from bus_ros.rclpy.impl.logging_severity import LoggingSeverity
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger, level_of

__all__ = [
    "LoggingSeverity",
    "clear_config",
    "get_logger",
    "get_logger_effective_level",
    "get_logger_level",
    "get_logging_directory",
    "get_logging_severity_from_string",
    "initialize",
    "set_logger_level",
    "shutdown",
]


_root_logger = RcutilsLogger("")
"""rclpy's private name of the root logger."""


def get_logger(name: str) -> RcutilsLogger:
    """The logger of that name; raises ValueError for an empty name."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return RcutilsLogger(name)


def initialize() -> None:
    """Does nothing: logging works from the first call."""


def shutdown() -> None:
    """Does nothing: each line is written at once."""


def clear_config() -> None:
    """Reset the level of every logger."""
    set_default_level(Severity.UNSET)
    for name in list(logging.root.manager.loggerDict):
        if name.startswith(f"{TOP_NAME}."):
            logging.getLogger(name).setLevel(logging.NOTSET)


def set_logger_level(name: str, level: int | LoggingSeverity, detailed_error: bool = False) -> None:
    """Set the lowest severity to log; an empty name: the default of all. ValueError for a wrong level.

    UNSET is the level of the parent; as the default of all, it logs everything.
    """
    RcutilsLogger(name).set_level(level)


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """The lowest severity that a logger of that name logs."""
    return RcutilsLogger(name).get_effective_level()


def get_logger_level(name: str) -> LoggingSeverity:
    """The level set for exactly that name; UNSET if there is none."""
    return level_of(RcutilsLogger(name))


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """The severity named `INFO` and so on, in any case; raises RuntimeError for an unknown name."""
    try:
        return LoggingSeverity[log_severity.upper()]
    except KeyError:
        raise RuntimeError(f"Failed to get log severity from name '{log_severity}'") from None


def get_logging_directory() -> Path:
    """ROS 2's folder for log files: $ROS_LOG_DIR, $ROS_HOME/log or ~/.ros/log. busd writes none."""
    if chosen := os.environ.get("ROS_LOG_DIR"):
        return Path(chosen).expanduser()
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "log"
