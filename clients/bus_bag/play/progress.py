"""The line of progress of a replay. Pure."""

from enum import Enum
from typing import NamedTuple

from bus.base.counted import counted

__all__ = ["Progress", "Status"]

_S = 1_000_000_000


class Status(Enum):
    """The activity of the player; the value is its letter in the line."""

    RUNNING = "R"
    PAUSED = "P"
    BURST = "B"
    DELAYED = "D"
    """It waits before its start, or reads messages after a seek."""
    AT_END = "E"


class Progress(NamedTuple):
    """The position of a player."""

    bag_ns: int
    start_ns: int
    end_ns: int
    rate: float
    messages: int
    status: Status

    def __str__(self) -> str:
        played, whole = (max(0, ns - self.start_ns) / _S for ns in (self.bag_ns, self.end_ns))
        seconds, part = divmod(self.bag_ns, _S)
        return (
            f"[{seconds}.{part:09d}] {min(played, whole):.2f}/{whole:.2f} s [{self.status.value}] "
            f"rate {self.rate:g}, {counted(self.messages, 'message')}"
        )
