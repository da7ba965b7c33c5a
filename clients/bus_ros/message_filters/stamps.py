"""The time of a message: its header's stamp, or the time of its arrival if it has none."""

from typing import Any

from bus_ros.rclpy.clock import ROSClock
from bus_ros.rclpy.logging import LoggingSeverity, get_logger
from bus_ros.rclpy.time import Time

__all__ = ["header_stamp", "now", "warn_of_headerless"]

_HEADERLESS = (
    "without timestamp infomation when 'allow_headerless' is disabled. auto assign ROSTIME to headerless "
    "messages once enabling constructor option of 'allow_headerless'."
)
"""ROS 2's words."""


def header_stamp(msg: Any) -> Time | None:
    """The stamp of a message's header, which may be a message or a Time; None if it has none."""
    try:
        stamp = msg.header.stamp
    except AttributeError:
        return None
    return stamp if hasattr(stamp, "nanoseconds") else Time.from_msg(stamp)


def now() -> Time:
    return ROSClock().now()


def warn_of_headerless(logger_name: str, beginning: str) -> None:
    """Log that a message was left out because it has no stamp."""
    logger = get_logger(logger_name)
    logger.set_level(LoggingSeverity.INFO)
    logger.warning(f"{beginning} {_HEADERLESS}")
