"""Checks the name of a topic or service as it stands in the graph. The rules are those of `bus.names`."""

from bus import names
from bus.errors import ConfigurationError
from bus_ros.rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException

__all__ = ["validate_full_topic_name"]


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """True, or raises InvalidTopicNameException (InvalidServiceNameException for a service)."""
    try:
        names.validate_full_topic_name(name)
    except ConfigurationError as error:
        kind = InvalidServiceNameException if is_service else InvalidTopicNameException
        raise kind.of(name, error) from None
    return True
