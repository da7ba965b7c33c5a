"""A module in the place of rclpy's C extension: its errors, enums, and entities for wait sets."""

from types import SimpleNamespace
from typing import Any

from bus_ros.rclpy import exceptions
from bus_ros.rclpy.clock import ClockChange, ClockEvent, ClockType
from bus_ros.rclpy.impl.transition_callback_return import TransitionCallbackReturnType

__all__ = ["rclpy_implementation"]

_ENTITIES = (
    *("Client", "EventHandle", "GuardCondition", "Publisher", "Service", "Subscription", "Timer"),
    "WaitSet",
)


class _Implementation(SimpleNamespace):
    """Imports its entities at their first use: few programs have their own waitables."""

    def __getattr__(self, name: str) -> Any:
        if name in _ENTITIES:
            from bus_ros.rclpy.impl import events, wait_set

            return getattr(events if name == "EventHandle" else wait_set, name)
        raise AttributeError(f"rclpy_implementation has no {name}")


rclpy_implementation = _Implementation(
    ClockChange=ClockChange,
    ClockEvent=ClockEvent,
    ClockType=ClockType,
    InvalidHandle=exceptions.InvalidHandle,
    NodeNameNonExistentError=exceptions.NodeNameNonExistentError,
    RCLError=exceptions.RCLError,
    RCLInvalidROSArgsError=exceptions.RCLInvalidROSArgsError,
    TimerCancelledError=exceptions.TimerCancelledError,
    TransitionCallbackReturnType=TransitionCallbackReturnType,
    UnknownROSArgsError=exceptions.UnknownROSArgsError,
    UnsupportedEventTypeError=exceptions.UnsupportedEventTypeError,
)
"""Programs import it as `_rclpy` and catch `_rclpy.RCLError`."""
