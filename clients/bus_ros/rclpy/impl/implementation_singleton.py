"""Stands where rclpy keeps its C extension: of that, programs use the errors and the clocks' enums."""

from types import SimpleNamespace

from bus_ros.rclpy import exceptions
from bus_ros.rclpy.clock import ClockChange, ClockEvent, ClockType

__all__ = ["rclpy_implementation"]

rclpy_implementation = SimpleNamespace(
    ClockChange=ClockChange,
    ClockEvent=ClockEvent,
    ClockType=ClockType,
    InvalidHandle=exceptions.InvalidHandle,
    NodeNameNonExistentError=exceptions.NodeNameNonExistentError,
    RCLError=exceptions.RCLError,
    RCLInvalidROSArgsError=exceptions.RCLInvalidROSArgsError,
    TimerCancelledError=exceptions.TimerCancelledError,
    UnknownROSArgsError=exceptions.UnknownROSArgsError,
    UnsupportedEventTypeError=exceptions.UnsupportedEventTypeError,
)
"""Programs import it as `_rclpy` and catch `_rclpy.RCLError`."""
