"""`ros2action.api`: names and types of actions, their servers and clients."""

from typing import Any

from bus_ros.rclpy import action
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.validate_topic_name import expand_topic_name, validate_full_topic_name
from bus_ros.rosidl.interfaces import get_action_interfaces

__all__ = [
    "action_type_completer",
    "get_action_clients_and_servers",
    "get_action_names",
    "get_action_names_and_types",
]

Ends = list[tuple[str, list[str]]]


def get_action_names_and_types(*, node: Node) -> list[tuple[str, list[str]]]:
    """All actions that have a server or a client, with their types."""
    return action.get_action_names_and_types(node)


def get_action_names(*, node: Node) -> list[str]:
    """The names of all actions that have a server or a client."""
    return [name for name, _ in get_action_names_and_types(node=node)]


def get_action_clients_and_servers(*, node: Node, action_name: str) -> tuple[Ends, Ends]:
    """The nodes that call an action, and the nodes that serve it: the full name of each, and the types.

    Raises ValueError or InvalidTopicNameException for an invalid name.
    """
    full = expand_topic_name(action_name, node.get_name(), node.get_namespace())
    validate_full_topic_name(full)
    clients: Ends = []
    servers: Ends = []
    for name, namespace in node.get_node_names_and_namespaces():
        owner = f"{namespace.rstrip('/')}/{name}"
        for ends, find in (
            (clients, action.get_action_client_names_and_types_by_node),
            (servers, action.get_action_server_names_and_types_by_node),
        ):
            ends += [(owner, types) for one, types in find(node, name, namespace) if one == full]
    return clients, servers


def action_type_completer(**kwargs: Any) -> list[str]:
    """All actions that have a definition: `example_interfaces/action/Fibonacci`."""
    return [f"{package}/{name}" for package, names in get_action_interfaces().items() for name in names]
