"""builtin_interfaces of ROS 2 Jazzy: time.

Made by `make messages`.
"""

from bus.msg._types import Message, int32, uint32

__all__ = [
    "Duration",
    "Time",
]


class Duration(Message, kw_only=True):
    """A span of time; negative where `sec` is."""

    sec: int32 = 0
    nanosec: uint32 = 0


class Time(Message, kw_only=True):
    """A point in time, since 1970 for the system clock."""

    sec: int32 = 0
    nanosec: uint32 = 0
