"""Spans of time in whole nanoseconds, with the arithmetic of rclpy.duration. Must not know clocks."""

import math
from functools import cache
from typing import Any

__all__ = ["Duration", "Infinite"]

S_TO_NS = 1_000_000_000
"""Nanoseconds in a second."""

_LEAST, _MOST = -(2**63), 2**63 - 1


class Duration:
    """A span of time; may be negative. A fraction of `seconds` counts, a fraction of `nanoseconds` doesn't.

    Raises OverflowError if the span does not fit into 64 bits of nanoseconds.
    """

    __slots__ = ("_nanoseconds",)

    def __init__(self, *, seconds: float = 0, nanoseconds: float = 0) -> None:
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not _LEAST <= total <= _MOST:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """The whole duration."""
        return self._nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self._nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self == Infinite else f"{self._nanoseconds} nanoseconds"

    def __add__(self, other: "Duration") -> "Duration":
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self._nanoseconds + other._nanoseconds)

    def __sub__(self, other: "Duration") -> "Duration":
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)

    def __mul__(self, other: float) -> "Duration":
        if isinstance(other, float) and not math.isfinite(other):
            if other == math.inf:
                return Infinite
            raise ValueError("Can't multiply duration with nan")
        if not isinstance(other, int | float):
            return NotImplemented
        return Duration(nanoseconds=self._nanoseconds * other)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Duration):
            return NotImplemented
        return self._nanoseconds == other._nanoseconds

    def __hash__(self) -> int:
        return hash(self._nanoseconds)

    def __lt__(self, other: "Duration") -> bool:
        return self._nanoseconds < other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __le__(self, other: "Duration") -> bool:
        return self._nanoseconds <= other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __gt__(self, other: "Duration") -> bool:
        return self._nanoseconds > other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def __ge__(self, other: "Duration") -> bool:
        return self._nanoseconds >= other._nanoseconds if isinstance(other, Duration) else NotImplemented

    def to_msg(self) -> Any:
        """The builtin_interfaces.msg.Duration."""
        seconds, nanoseconds = divmod(self._nanoseconds, S_TO_NS)
        return _message_class()(sec=seconds, nanosec=nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> "Duration":
        """From a builtin_interfaces.msg.Duration; raises TypeError for anything else."""
        if not isinstance(msg, _message_class()):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


Infinite = Duration(nanoseconds=_MOST)
"""Longer than any other: in a QoS policy, no limit."""


@cache
def _message_class() -> Any:
    from bus_ros.rosidl import message_class  # late: few programs convert durations

    return message_class("builtin_interfaces/msg/Duration")
