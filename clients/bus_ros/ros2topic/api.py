"""`ros2topic.api`: names and types of topics, and QoS by the names of command lines."""

from argparse import ArgumentParser, ArgumentTypeError
from copy import copy
from time import sleep
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import InvalidTopicNameException
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
)
from bus_ros.rclpy.validate_topic_name import (
    expand_topic_name,
    topic_or_service_is_hidden,
    validate_full_topic_name,
)
from bus_ros.ros2cli.helpers import unsigned_int
from bus_ros.rosidl.interfaces import get_message_interfaces
from bus_ros.rosidl.utilities import get_message

__all__ = [
    "add_qos_arguments",
    "get_msg_class",
    "get_topic_names",
    "get_topic_names_and_types",
    "message_type_completer",
    "positive_float",
    "positive_int",
    "profile_configure_short_keys",
    "qos_profile_from_short_keys",
    "unsigned_int",
]

_POLL_S = 0.1


def positive_int(string: str) -> int:
    """The type of an argument that is a whole number from 1; raises ArgumentTypeError."""
    try:
        value = int(string)
    except ValueError:
        value = -1
    if value <= 0:
        raise ArgumentTypeError("value must be a positive integer")
    return value


def positive_float(inval: str) -> float:
    """The type of an argument that is a number above 0; raises ArgumentTypeError."""
    try:
        value = float(inval)
    except ValueError:
        raise ArgumentTypeError("Expects a floating point number") from None
    if value <= 0.0:
        raise ArgumentTypeError("Value must be positive")
    return value


def get_topic_names_and_types(
    *, node: Node, include_hidden_topics: bool = False
) -> list[tuple[str, list[str]]]:
    """All topics with their types. Unless included, hidden topics are left out: a token of their name begins
    with `_`.
    """
    found = node.get_topic_names_and_types()
    if include_hidden_topics:
        return found
    return [(name, types) for name, types in found if not topic_or_service_is_hidden(name)]


def get_topic_names(*, node: Node, include_hidden_topics: bool = False) -> list[str]:
    """The names of all topics; as `get_topic_names_and_types`."""
    found = get_topic_names_and_types(node=node, include_hidden_topics=include_hidden_topics)
    return [name for name, _ in found]


def message_type_completer(**kwargs: Any) -> list[str]:
    """All messages that have a definition: `std_msgs/msg/String`."""
    return [f"{package}/{name}" for package, names in get_message_interfaces().items() for name in names]


def get_msg_class(node: Node, topic: str, blocking: bool = False, include_hidden_topics: bool = False) -> Any:
    """The class of a topic's messages.

    If there is no such topic, prints a warning and returns None. With `blocking` it waits for the topic
    instead, until the context is shut down. Raises RuntimeError for an invalid name, a topic with several
    types, or a type without definition.
    """
    found = _msg_class(node, topic, include_hidden_topics)
    if found is not None:
        return found
    print(f"WARNING: topic [{topic}] does not appear to be published yet")
    while found is None and blocking and rclpy.ok():
        sleep(_POLL_S)
        found = _msg_class(node, topic, include_hidden_topics)
    return found


def _msg_class(node: Node, topic: str, include_hidden_topics: bool) -> type | None:
    try:
        full = expand_topic_name(topic, node.get_name(), node.get_namespace())
        validate_full_topic_name(full)
    except (InvalidTopicNameException, ValueError) as error:
        raise RuntimeError(error) from None
    found = get_topic_names_and_types(node=node, include_hidden_topics=include_hidden_topics)
    types = dict(found).get(full)
    if types is None:
        return None
    if len(types) > 1:
        raise RuntimeError(
            f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(types)}]"
        )
    try:
        return get_message(types[0])
    except (AttributeError, ModuleNotFoundError, ValueError):
        raise RuntimeError(f"The message type '{types[0]}' is invalid") from None


def profile_configure_short_keys(
    profile: QoSProfile,
    reliability: str | None = None,
    durability: str | None = None,
    depth: int | None = None,
    history: str | None = None,
    liveliness: str | None = None,
    liveliness_lease_duration_s: float | None = None,
) -> None:
    """Change the given policies of `profile`, each by its name on a command line: `best_effort`.

    If no depth is given, a depth of 0 becomes 1 with the durability transient_local. Raises KeyError for an
    unknown name.
    """
    if history:
        profile.history = HistoryPolicy(HistoryPolicy.get_from_short_key(history))
    if durability:
        profile.durability = DurabilityPolicy(DurabilityPolicy.get_from_short_key(durability))
    if reliability:
        profile.reliability = ReliabilityPolicy(ReliabilityPolicy.get_from_short_key(reliability))
    if liveliness:
        profile.liveliness = LivelinessPolicy(LivelinessPolicy.get_from_short_key(liveliness))
    if liveliness_lease_duration_s and liveliness_lease_duration_s >= 0:
        profile.liveliness_lease_duration = Duration(seconds=liveliness_lease_duration_s)
    if depth and depth >= 0:
        profile.depth = depth
    elif profile.durability == DurabilityPolicy.TRANSIENT_LOCAL and profile.depth == 0:
        profile.depth = 1


def qos_profile_from_short_keys(
    preset_profile: str,
    reliability: str | None = None,
    durability: str | None = None,
    depth: int | None = None,
    history: str | None = None,
    liveliness: str | None = None,
    liveliness_lease_duration_s: float | None = None,
) -> QoSProfile:
    """A preset by its name on a command line, `sensor_data`, changed by `profile_configure_short_keys`."""
    profile = copy(QoSPresetProfiles.get_from_short_key(preset_profile))
    profile_configure_short_keys(
        profile, reliability, durability, depth, history, liveliness, liveliness_lease_duration_s
    )
    return profile


def add_qos_arguments(parser: ArgumentParser, subscribe_or_publish: str, default_profile_str: str) -> None:
    """Add the options of a QoS profile to a parser: `--qos-profile`, `--qos-depth`, and others."""
    preset = QoSPresetProfiles.get_from_short_key(default_profile_str)
    parser.add_argument(
        "--qos-profile",
        choices=QoSPresetProfiles.short_keys(),
        default=default_profile_str,
        help=f"the preset to {subscribe_or_publish} with (default: {default_profile_str})",
    )
    parser.add_argument(
        "--qos-depth", metavar="N", type=int, help="the depth, instead of the depth of the preset"
    )
    for policy, enum in (
        ("history", HistoryPolicy),
        ("reliability", ReliabilityPolicy),
        ("durability", DurabilityPolicy),
        ("liveliness", LivelinessPolicy),
    ):
        parser.add_argument(
            f"--qos-{policy}",
            choices=enum.short_keys(),
            help=f"the {policy}, instead of the preset's (default: {getattr(preset, policy).short_key})",
        )
    parser.add_argument(
        "--qos-liveliness-lease-duration-seconds",
        type=float,
        help="the lease duration of the liveliness, instead of the preset's",
    )
