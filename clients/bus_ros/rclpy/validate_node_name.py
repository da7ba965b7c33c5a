"""Checks the name of a node. The rules are those of `bus.names`."""

from bus import names
from bus.errors import ConfigurationError
from bus_ros.rclpy.exceptions import InvalidNodeNameException

__all__ = ["validate_node_name"]


def validate_node_name(node_name: str) -> bool:
    """True, or raises InvalidNodeNameException."""
    try:
        names.validate_node_name(node_name)
    except ConfigurationError as error:
        raise InvalidNodeNameException.of(node_name, error) from None
    return True
