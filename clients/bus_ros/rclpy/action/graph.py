"""Names and types of actions, as functions of a node."""

from bus_ros.rclpy.node import BaseNode

__all__ = [
    "get_action_client_names_and_types_by_node",
    "get_action_names_and_types",
    "get_action_server_names_and_types_by_node",
]

NamesAndTypes = list[tuple[str, list[str]]]


def get_action_client_names_and_types_by_node(
    node: BaseNode, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node calls. Raises NodeNameNonExistentError."""
    return node.get_action_client_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_action_server_names_and_types_by_node(
    node: BaseNode, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node serves. Raises NodeNameNonExistentError."""
    return node.get_action_server_names_and_types_by_node(remote_node_name, remote_node_namespace)


def get_action_names_and_types(node: BaseNode) -> NamesAndTypes:
    """All actions that have a server or a client."""
    return node.get_action_names_and_types()
