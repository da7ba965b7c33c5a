"""The severities of a log, with the numbers of rcutils and `bus.logger`."""

from enum import IntEnum

__all__ = ["LoggingSeverity"]


class LoggingSeverity(IntEnum):
    """UNSET as a logger's level means: the level of its parent."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50
