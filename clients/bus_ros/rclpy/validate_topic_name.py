"""Checks names and expands them, with rclpy's exceptions. `bus.names` has the rules.

rclpy has a module for each function; `bus_ros.aliases` has the table of them.
"""

from collections.abc import Callable

from bus import names
from bus.errors import ConfigurationError
from bus_ros.rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidParameterException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    rule_of,
)

__all__ = [
    "HIDDEN_TOPIC_PREFIX",
    "TOPIC_SEPARATOR_STRING",
    "expand_topic_name",
    "full_name",
    "topic_or_service_is_hidden",
    "validate_full_topic_name",
    "validate_namespace",
    "validate_node_name",
    "validate_parameter_name",
    "validate_topic_name",
]

TOPIC_SEPARATOR_STRING = "/"
HIDDEN_TOPIC_PREFIX = "_"


def validate_topic_name(name: str, *, is_service: bool = False) -> bool:
    """Check a name as typed. True, or raises InvalidTopicNameException (InvalidServiceNameException)."""
    try:
        names.validate_topic_name(name)
    except ConfigurationError as error:
        kind = InvalidServiceNameException if is_service else InvalidTopicNameException
        raise kind.of(name, error) from None
    return True


def validate_full_topic_name(name: str, *, is_service: bool = False) -> bool:
    """Check a full name, as in the graph; returns and raises as `validate_topic_name`."""
    try:
        names.validate_full_topic_name(name)
    except ConfigurationError as error:
        kind = InvalidServiceNameException if is_service else InvalidTopicNameException
        raise kind.of(name, error) from None
    return True


def validate_node_name(node_name: str) -> bool:
    """True, or raises InvalidNodeNameException."""
    try:
        names.validate_node_name(node_name)
    except ConfigurationError as error:
        raise InvalidNodeNameException.of(node_name, error) from None
    return True


def validate_namespace(namespace: str) -> bool:
    """True, or raises InvalidNamespaceException."""
    try:
        names.validate_namespace(namespace)
    except ConfigurationError as error:
        raise InvalidNamespaceException.of(namespace, error) from None
    return True


def validate_parameter_name(name: str) -> bool:
    """True, or raises InvalidParameterException: ROS 2 allows all names but the empty one."""
    if not name:
        raise InvalidParameterException(name)
    return True


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """The name with `~` and `{node}` replaced, and the namespace in front; ValueError for a wrong name."""
    try:
        return names.expand_topic_name(topic_name, node_name, node_namespace)
    except ConfigurationError as error:
        raise ValueError(f"topic name '{topic_name}' is invalid: {rule_of(error)}") from None


def full_name(name: str, resolve: Callable[[str], str], *, is_service: bool = False) -> str:
    """The full name that `resolve` finds; errors in `name` have the texts of rclpy's node.

    Raises ValueError if the typed name is wrong, InvalidTopicNameException (InvalidServiceNameException) if
    only the full name is.
    """
    is_typed_right = False
    try:
        names.validate_topic_name(name)
        is_typed_right = True
        return resolve(name)
    except ConfigurationError as error:
        rule = rule_of(error)
        if is_typed_right and not rule.startswith("unknown substitution"):
            kind = InvalidServiceNameException if is_service else InvalidTopicNameException
            raise kind.of(name, error) from None
        raise ValueError(f"topic name '{name}' is invalid: {rule}") from None


def topic_or_service_is_hidden(name: str) -> bool:
    """Whether a token of the name begins with `_`."""
    return names.is_hidden_topic(name)
