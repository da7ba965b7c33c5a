"""Points in time, each of one kind of clock, with the arithmetic of rclpy.time. Must not know clocks."""

from enum import IntEnum
from functools import cache
from typing import TYPE_CHECKING, Any, overload

from bus_ros.rclpy.duration import S_TO_NS, Duration

if TYPE_CHECKING:
    from datetime import datetime

__all__ = ["ClockType", "Duration", "Time"]

_END_NS = 2**63


class ClockType(IntEnum):
    """The epoch of a clock, and whether it can jump. The numbers are rcl_clock_type_t's."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    """As SYSTEM_TIME, or the simulation's time while `use_sim_time` is set."""
    SYSTEM_TIME = 2
    """Since 1970; jumps when the machine's date is set."""
    STEADY_TIME = 3
    """Since some moment in the past; never jumps."""


class Time:
    """Time since the epoch of a clock's type; only times of one type can be compared and subtracted.

    Raises ValueError for negative values, OverflowError if the time does not fit into 64 bits of nanoseconds.
    """

    __slots__ = ("_clock_type", "_nanoseconds")

    def __init__(
        self,
        *,
        seconds: float = 0,
        nanoseconds: float = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if total >= _END_NS:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._nanoseconds = total
        self._clock_type = clock_type

    @classmethod
    def of_clock(cls, nanoseconds: int, clock_type: ClockType) -> "Time":
        """A time without checks, because clocks are read often."""
        time = cls.__new__(cls)
        time._nanoseconds = nanoseconds
        time._clock_type = clock_type
        return time

    @property
    def nanoseconds(self) -> int:
        """The whole time since the epoch."""
        return self._nanoseconds

    @property
    def clock_type(self) -> ClockType:
        return self._clock_type

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Whole seconds, and the remaining nanoseconds."""
        return divmod(self._nanoseconds, S_TO_NS)

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self._nanoseconds}, clock_type={self._clock_type.name})"

    def __add__(self, other: Duration) -> "Time":
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self._nanoseconds + other.nanoseconds, clock_type=self._clock_type)
        except OverflowError as error:
            raise OverflowError("Addition leads to overflow in C storage.") from error

    __radd__ = __add__

    @overload
    def __sub__(self, other: "Time") -> Duration: ...
    @overload
    def __sub__(self, other: Duration) -> "Time": ...
    def __sub__(self, other: "Time | Duration") -> "Time | Duration":
        if isinstance(other, Time):
            if self._clock_type is not other._clock_type:
                raise TypeError("Can't subtract times with different clock types")
            return Duration(nanoseconds=self._nanoseconds - other._nanoseconds)
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self._nanoseconds - other.nanoseconds, clock_type=self._clock_type)
        except ValueError as error:
            raise ValueError("Subtraction leads to negative time.") from error

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Time):
            return NotImplemented
        return self._nanoseconds == self._comparable(other)

    def __hash__(self) -> int:
        return hash(self._nanoseconds)

    def __lt__(self, other: "Time") -> bool:
        return self._nanoseconds < self._comparable(other) if isinstance(other, Time) else NotImplemented

    def __le__(self, other: "Time") -> bool:
        return self._nanoseconds <= self._comparable(other) if isinstance(other, Time) else NotImplemented

    def __gt__(self, other: "Time") -> bool:
        return self._nanoseconds > self._comparable(other) if isinstance(other, Time) else NotImplemented

    def __ge__(self, other: "Time") -> bool:
        return self._nanoseconds >= self._comparable(other) if isinstance(other, Time) else NotImplemented

    def _comparable(self, other: "Time") -> int:
        if self._clock_type is not other._clock_type:
            raise TypeError("Can't compare times with different clock types")
        return other._nanoseconds

    def to_msg(self) -> Any:
        """The builtin_interfaces.msg.Time."""
        seconds, nanoseconds = divmod(self._nanoseconds, S_TO_NS)
        return _message_class()(sec=seconds, nanosec=nanoseconds)

    def to_datetime(self) -> "datetime":
        """The local time, to the microsecond; raises TypeError for a steady clock's time."""
        from datetime import datetime

        if self._clock_type not in (ClockType.ROS_TIME, ClockType.SYSTEM_TIME):
            raise TypeError("Time object's clock type should be either ROS_TIME or SYSTEM_TIME")
        return datetime.fromtimestamp(self._nanoseconds / S_TO_NS)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: ClockType = ClockType.ROS_TIME) -> "Time":
        """From a builtin_interfaces.msg.Time; raises TypeError for anything else."""
        if not isinstance(msg, _message_class()):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)


@cache
def _message_class() -> Any:
    from bus_ros.rosidl import message_class  # late: the first stamp pays for it

    return message_class("builtin_interfaces/msg/Time")
