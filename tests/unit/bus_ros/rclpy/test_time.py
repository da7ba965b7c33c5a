"""Times and durations of the facade: arithmetic, comparison, messages, mistakes."""

import math
from collections.abc import Callable
from datetime import datetime
from typing import Any

import pytest

from bus_ros.rclpy import time as time_module
from bus_ros.rclpy.duration import Duration, Infinite
from bus_ros.rclpy.time import ClockType, Time
from bus_ros.rosidl import message_class
from rows import for_each

ROS = ClockType.ROS_TIME
STEADY = ClockType.STEADY_TIME


def test_seconds_and_nanoseconds_add_up() -> None:
    assert Time(seconds=1.5, nanoseconds=7).nanoseconds == 1_500_000_007
    assert Time(seconds=3, nanoseconds=4).seconds_nanoseconds() == (3, 4)
    assert Time().clock_type is ClockType.SYSTEM_TIME
    assert Duration(seconds=-1.5, nanoseconds=0.9).nanoseconds == -1_500_000_000


def test_texts() -> None:
    assert repr(Time(nanoseconds=1, clock_type=ROS)) == "Time(nanoseconds=1, clock_type=ROS_TIME)"
    assert repr(Duration(nanoseconds=-2)) == "Duration(nanoseconds=-2)"
    assert str(Duration(nanoseconds=5)) == "5 nanoseconds"
    assert str(Infinite) == "Infinite"


def test_time_arithmetic() -> None:
    begin = Time(seconds=2, clock_type=ROS)
    assert begin + Duration(seconds=1) == Duration(seconds=1) + begin == Time(seconds=3, clock_type=ROS)
    assert begin - Duration(seconds=1) == Time(seconds=1, clock_type=ROS)
    assert begin - Time(seconds=5, clock_type=ROS) == Duration(seconds=-3)


def test_duration_arithmetic() -> None:
    one = Duration(seconds=1)
    assert one + one == one * 2 == Duration(seconds=2)
    assert one - one * 3 == Duration(seconds=-2)
    assert one * 0.25 == Duration(nanoseconds=250_000_000)
    assert one * math.inf == Infinite
    with pytest.raises(ValueError, match="Can't multiply duration with nan"):
        one * math.nan


def test_order() -> None:
    early, late = Time(seconds=1), Time(seconds=2)
    assert early < late and early <= late and late > early and late >= early and early != late
    assert max(early, late) is late
    short, long = Duration(seconds=1), Duration(seconds=2)
    assert short < long and short <= long and long > short and long >= short and short != long
    assert early != 1 and short != 1


@for_each(
    "compare",
    [
        lambda a, b: a == b,
        lambda a, b: a != b,
        lambda a, b: a < b,
        lambda a, b: a <= b,
        lambda a, b: a > b,
        lambda a, b: a >= b,
    ],
)
def test_times_of_different_clocks_do_not_compare(compare: Callable[[Any, Any], bool]) -> None:
    with pytest.raises(TypeError, match="Can't compare times with different clock types"):
        compare(Time(clock_type=ROS), Time(clock_type=STEADY))


def test_times_of_different_clocks_do_not_subtract() -> None:
    with pytest.raises(TypeError, match="Can't subtract times with different clock types"):
        Time(clock_type=ROS) - Time(clock_type=STEADY)


def test_out_of_range() -> None:
    with pytest.raises(ValueError, match="Seconds value must not be negative"):
        Time(seconds=-1)
    with pytest.raises(ValueError, match="Nanoseconds value must not be negative"):
        Time(nanoseconds=-1)
    with pytest.raises(
        OverflowError, match=r"Total nanoseconds value is too large to store in C time point."
    ):
        Time(nanoseconds=2**63)
    with pytest.raises(OverflowError, match=r"Total nanoseconds value is too large to store in C duration."):
        Duration(nanoseconds=-(2**63) - 1)
    with pytest.raises(OverflowError, match=r"Addition leads to overflow in C storage."):
        Time(nanoseconds=2**63 - 1) + Duration(nanoseconds=1)
    with pytest.raises(ValueError, match=r"Subtraction leads to negative time."):
        Time() - Duration(nanoseconds=1)


@for_each(
    "wrong",
    [
        lambda: Time() + 1,  # type: ignore[operator]
        lambda: Time() + Time(),  # type: ignore[operator]
        lambda: Time() - 1,  # type: ignore[operator]
        lambda: Time() < 1,  # type: ignore[operator]
        lambda: Duration() + 1,  # type: ignore[operator]
        lambda: Duration() - 1,  # type: ignore[operator]
        lambda: Duration() * "2",  # type: ignore[operator]
        lambda: Duration() >= 1,  # type: ignore[operator]
        lambda: Time(clock_type=3),  # type: ignore[arg-type]
        lambda: Time(5),
    ],
)
def test_other_types(wrong: Callable[[], object]) -> None:
    with pytest.raises(TypeError):
        wrong()


def test_messages() -> None:
    stamp = Time(seconds=7, nanoseconds=8).to_msg()
    assert type(stamp) is message_class("builtin_interfaces/msg/Time")
    assert (stamp.sec, stamp.nanosec) == (7, 8)  # type: ignore[attr-defined]
    assert Time.from_msg(stamp) == Time(seconds=7, nanoseconds=8, clock_type=ROS)
    assert Time.from_msg(stamp, clock_type=STEADY).clock_type is STEADY
    span = Duration(seconds=-0.5).to_msg()
    assert (span.sec, span.nanosec) == (-1, 500_000_000)
    assert Duration.from_msg(span) == Duration(seconds=-0.5)
    with pytest.raises(TypeError, match=r"Must pass a builtin_interfaces.msg.Time object"):
        Time.from_msg(span)
    with pytest.raises(TypeError, match=r"Must pass a builtin_interfaces.msg.Duration object"):
        Duration.from_msg(stamp)


def test_datetime() -> None:
    assert Time(seconds=1_700_000_000.5).to_datetime() == datetime.fromtimestamp(1_700_000_000.5)
    with pytest.raises(TypeError, match="either ROS_TIME or SYSTEM_TIME"):
        Time(clock_type=STEADY).to_datetime()


def test_names_that_programs_reach_through_rclpy_time() -> None:
    assert time_module.Duration is Duration
    assert time_module.ClockType is ClockType
