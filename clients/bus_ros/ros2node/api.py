"""`ros2node.api`: names of nodes, and the endpoints of a node."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from bus_ros.rclpy import action
from bus_ros.rclpy.node import HIDDEN_NODE_PREFIX, Node
from bus_ros.ros2cli.helpers import wait_for

__all__ = [
    "INFO_NONUNIQUE_WARNING_TEMPLATE",
    "NodeName",
    "TopicInfo",
    "get_absolute_node_name",
    "get_action_client_info",
    "get_action_server_info",
    "get_node_names",
    "get_publisher_info",
    "get_service_client_info",
    "get_service_server_info",
    "get_subscriber_info",
    "get_topics",
    "has_duplicates",
    "parse_node_name",
    "wait_for_node",
]

NamesAndTypes = list[tuple[str, list[str]]]

INFO_NONUNIQUE_WARNING_TEMPLATE = (
    'There are {num_nodes} nodes in the graph with the exact name "{node_name}". '
    "You are seeing information about only one of them."
)


class NodeName(NamedTuple):
    """The names of a node: `talker`, `/robot`, `/robot/talker`."""

    name: str
    namespace: str
    full_name: str


class TopicInfo(NamedTuple):
    """A topic, a service or an action of a node, and its types."""

    name: str
    types: list[str]


def get_absolute_node_name(node_name: str) -> str | None:
    """The name with a slash in front; None if it is empty."""
    if not node_name:
        return None
    return node_name if node_name.startswith("/") else f"/{node_name}"


def parse_node_name(node_name: str) -> NodeName:
    """The parts of a full name; its slash may be missing."""
    full = node_name if node_name.startswith("/") else f"/{node_name}"
    namespace, _, name = full.rpartition("/")
    return NodeName(name, namespace or "/", full)


def has_duplicates(values: Sequence[Any]) -> bool:
    """Whether a value occurs more than once."""
    return len(set(values)) < len(values)


def get_node_names(*, node: Node, include_hidden_nodes: bool = False) -> list[NodeName]:
    """All nodes. Unless included, hidden nodes (names that begin with `_`) are left out."""
    return [
        NodeName(name, namespace, f"{namespace.rstrip('/')}/{name}")
        for name, namespace in node.get_node_names_and_namespaces()
        if include_hidden_nodes or (name and not name.startswith(HIDDEN_NODE_PREFIX))
    ]


def wait_for_node(
    node: Node, node_name: str, include_hidden_nodes: bool = False, timeout: float = 1.0
) -> bool:
    """Wait for a node with this full name, at most `timeout` seconds; returns whether it is in the graph."""

    def is_there() -> bool:
        found = get_node_names(node=node, include_hidden_nodes=include_hidden_nodes)
        return any(one.full_name == node_name for one in found)

    return wait_for(is_there, timeout)


def get_topics(
    remote_node_name: str,
    func: Callable[[str, str], NamesAndTypes],
    *,
    include_hidden_topics: bool = False,
) -> list[TopicInfo]:
    """The endpoints that `func` finds by the name and the namespace of a node."""
    remote = parse_node_name(remote_node_name)
    return [
        TopicInfo(name, types)
        for name, types in func(remote.name, remote.namespace)
        if include_hidden_topics or not _is_hidden_name(name)
    ]


def get_subscriber_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """The subscriptions of a node. Raises NodeNameNonExistentError, as the functions below."""
    find = node.get_subscriber_names_and_types_by_node
    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def get_publisher_info(*, node: Node, remote_node_name: str, include_hidden: bool = False) -> list[TopicInfo]:
    """The publishers of a node."""
    find = node.get_publisher_names_and_types_by_node
    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def get_service_client_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """The services that a node calls."""
    find = node.get_client_names_and_types_by_node
    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def get_service_server_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """The services that a node offers."""
    find = node.get_service_names_and_types_by_node
    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def get_action_server_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """The actions that a node serves."""

    def find(name: str, namespace: str) -> NamesAndTypes:
        return action.get_action_server_names_and_types_by_node(node, name, namespace)

    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def get_action_client_info(
    *, node: Node, remote_node_name: str, include_hidden: bool = False
) -> list[TopicInfo]:
    """The actions that a node calls."""

    def find(name: str, namespace: str) -> NamesAndTypes:
        return action.get_action_client_names_and_types_by_node(node, name, namespace)

    return get_topics(remote_node_name, find, include_hidden_topics=include_hidden)


def _is_hidden_name(name: str) -> bool:
    return any(part.startswith(HIDDEN_NODE_PREFIX) for part in name.split("/"))
