"""Checks the name of a parameter: ROS 2 allows all but the empty one."""

from bus_ros.rclpy.exceptions import InvalidParameterException

__all__ = ["validate_parameter_name"]


def validate_parameter_name(name: str) -> bool:
    """True, or raises InvalidParameterException."""
    if not name:
        raise InvalidParameterException(name)
    return True
