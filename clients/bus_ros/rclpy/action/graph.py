"""Names and types of actions, found in a node's view of topics, as rcl_action does."""

from bus_actions.graph import actions_of_topics
from bus_ros.rclpy.node import Node

__all__ = [
    "get_action_client_names_and_types_by_node",
    "get_action_names_and_types",
    "get_action_server_names_and_types_by_node",
]

NamesAndTypes = list[tuple[str, list[str]]]


def get_action_client_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node calls. Raises NodeNameNonExistentError."""
    return _actions(
        node.get_subscriber_names_and_types_by_node(remote_node_name, remote_node_namespace, no_demangle=True)
    )


def get_action_server_names_and_types_by_node(
    node: Node, remote_node_name: str, remote_node_namespace: str
) -> NamesAndTypes:
    """The actions that a node serves. Raises NodeNameNonExistentError."""
    return _actions(
        node.get_publisher_names_and_types_by_node(remote_node_name, remote_node_namespace, no_demangle=True)
    )


def get_action_names_and_types(node: Node) -> NamesAndTypes:
    """All actions that have a server or a client."""
    return _actions(node.get_topic_names_and_types(no_demangle=True))


def _actions(topics: NamesAndTypes) -> NamesAndTypes:
    found = actions_of_topics((topic, type_name) for topic, types in topics for type_name in types)
    return list(found.items())
