"""Functions for the default context and the command line. Must not know executors or nodes."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bus_ros.rclpy.duration import S_TO_NS

if TYPE_CHECKING:
    from bus_ros.rclpy.context import Context

__all__ = [
    "get_available_rmw_implementations",
    "get_default_context",
    "get_rmw_implementation_identifier",
    "ok",
    "remove_ros_args",
    "shutdown",
    "timeout_sec_to_nsec",
    "try_shutdown",
]


def get_default_context(*, shutting_down: bool = False) -> "Context":
    """The context of all calls without one; `shutting_down`: the caller is going to end it."""
    from bus_ros.rclpy import context  # late: a parser of arguments needs none

    return context.get_default_context(shutting_down=shutting_down)


def ok(*, context: "Context | None" = None) -> bool:
    """Whether it is initialized and not shut down."""
    return (context or get_default_context()).ok()


def shutdown(*, context: "Context | None" = None) -> None:
    """Shut it down; raises RuntimeError if it is shut down already, or was never initialized."""
    (context or get_default_context(shutting_down=True)).shutdown()


def try_shutdown(*, context: "Context | None" = None) -> None:
    """Shut it down, unless it is already."""
    (context or get_default_context(shutting_down=True)).try_shutdown()


def remove_ros_args(args: Sequence[str] | None = None) -> list[str]:
    """The command line (`sys.argv`) without `--ros-args ... --`; raises ValueError for a malformed one."""
    from bus.process import ros_args

    return ros_args.remove_ros_args(sys.argv if args is None else args)


def get_rmw_implementation_identifier() -> str:
    return "rmw_busd"


def get_available_rmw_implementations() -> set[str]:
    """The names of the implementations: one."""
    return {get_rmw_implementation_identifier()}


def timeout_sec_to_nsec(timeout_sec: float | None) -> int:
    """A timeout in nanoseconds; None and negative numbers mean for ever: -1."""
    if timeout_sec is None or timeout_sec < 0:
        return -1
    return int(float(timeout_sec) * S_TO_NS)
