"""The severities of a log; the numbers are those of rcutils and `bus.logger`. Knows nothing else."""

from enum import IntEnum

__all__ = ["LoggingSeverity"]


class LoggingSeverity(IntEnum):
    """UNSET as a logger's level means: as its parent's."""

    UNSET = 0
    DEBUG = 10
    INFO = 20
    WARN = 30
    ERROR = 40
    FATAL = 50
