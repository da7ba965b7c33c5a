"""Checks a namespace. The rules are those of `bus.names`."""

from bus import names
from bus.errors import ConfigurationError
from bus_ros.rclpy.exceptions import InvalidNamespaceException

__all__ = ["validate_namespace"]


def validate_namespace(namespace: str) -> bool:
    """True, or raises InvalidNamespaceException."""
    try:
        names.validate_namespace(namespace)
    except ConfigurationError as error:
        raise InvalidNamespaceException.of(namespace, error) from None
    return True
