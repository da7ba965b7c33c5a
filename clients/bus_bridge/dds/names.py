"""Names of ROS 2 in DDS: topics, services, types, and the entries of USER_DATA.

Owns: the conversion in both directions. Must not know: which names the bus allows, QoS.
"""

import re
from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

from bus_bridge.ros2.type_names import type_from_dds, type_to_dds

__all__ = [
    "ENCLAVE",
    "GRAPH_TOPIC",
    "GRAPH_TYPE_HASH",
    "MARK",
    "ServicePart",
    "TopicKind",
    "bare_node_name",
    "kind_of",
    "service_part_from_dds",
    "service_to_dds",
    "service_types_to_dds",
    "topic_from_dds",
    "topic_to_dds",
    "user_data",
    "user_data_of",
]

TopicKind = Literal["topic", "service", "graph", "other"]

MARK: Final = "busd"
"""The key in USER_DATA by which busds recognize each other's endpoints."""
ENCLAVE: Final = "enclave"
"""The key in USER_DATA that each participant of ROS 2 has."""

GRAPH_TOPIC: Final = "ros_discovery_info"
GRAPH_TYPE_HASH: Final = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"

_SERVICE: Final = re.compile(r"r(?:q|r)(/.+?)(?:Request|Reply)", re.DOTALL)


def kind_of(dds_topic: str) -> TopicKind:
    """The kind of ROS 2 topic that a topic of DDS stands for."""
    if dds_topic.startswith("rt/"):
        return "topic"
    if dds_topic == GRAPH_TOPIC:
        return "graph"
    return "service" if _SERVICE.fullmatch(dds_topic) else "other"


def topic_to_dds(topic: str) -> str:
    """Convert `/a/b` to `rt/a/b`."""
    return f"rt{topic}"


def topic_from_dds(dds_topic: str) -> str | None:
    """Convert `rt/a/b` to `/a/b`; None if it is not a topic of ROS 2."""
    return dds_topic[2:] if dds_topic.startswith("rt/") else None


class ServicePart(NamedTuple):
    """The requests or the answers of a service."""

    service: str
    type_name: str
    """`std_srvs/srv/Trigger`"""
    is_request: bool


def service_part_from_dds(dds_topic: str, dds_type: str) -> ServicePart | None:
    """Convert `rq/sRequest`, or `rr/sReply`, with its type; None if it is not a topic of a service of
    ROS 2."""
    found, type_name = _SERVICE.fullmatch(dds_topic), type_from_dds(dds_type)
    if found is None or type_name is None:
        return None
    is_request = dds_topic.startswith("rq")
    bare = type_name.removesuffix("_Request" if is_request else "_Response")
    return None if bare == type_name else ServicePart(found[1], bare, is_request)


def service_to_dds(service: str) -> tuple[str, str]:
    """Convert `/s` to the topics of its requests and of its answers: `rq/sRequest` and `rr/sReply`."""
    return f"rq{service}Request", f"rr{service}Reply"


def service_types_to_dds(type_name: str) -> tuple[str, str]:
    """Convert `std_srvs/srv/Trigger` to the types of its requests and of its answers."""
    return type_to_dds(f"{type_name}_Request"), type_to_dds(f"{type_name}_Response")


def user_data(values: Mapping[str, str]) -> bytes:
    """USER_DATA as ROS 2 writes it: `key=value;` one after the other."""
    return "".join(f"{key}={value};" for key, value in values.items()).encode()


def user_data_of(data: bytes) -> dict[str, str]:
    """The entries of USER_DATA. Ignores everything except `key=value;`."""
    found: dict[str, str] = {}
    for part in data.rstrip(b"\0").decode("utf-8", "replace").split(";"):
        key, equals, value = part.partition("=")
        if equals:
            found.setdefault(key.strip(), value.strip())
    return found


def bare_node_name(participant: bytes) -> str:
    """The name of the node that stands for a participant with endpoints without nodes of ROS 2."""
    return f"_dds_{participant[:12].hex()}"
