"""`ros2lifecycle.api`: states and transitions of lifecycle nodes.

Each call asks several nodes at once, and spins `node` until all have answered.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_ros.ros2node import api as node_api
from bus_ros.ros2node.api import NodeName
from bus_ros.ros2service.api import get_service_names_and_types
from bus_ros.rosidl import service_class

__all__ = [
    "call_change_states",
    "call_get_available_transitions",
    "call_get_states",
    "call_get_transition_graph",
    "get_node_names",
]


def get_node_names(*, node: Node, include_hidden_nodes: bool = False) -> list[NodeName]:
    """The lifecycle nodes: all with a service `get_state`."""
    services = dict(get_service_names_and_types(node=node, include_hidden_services=include_hidden_nodes))
    return [
        one
        for one in node_api.get_node_names(node=node, include_hidden_nodes=include_hidden_nodes)
        if "lifecycle_msgs/srv/GetState" in services.get(f"{one.full_name}/get_state", ())
    ]


def call_get_states(*, node: Node, node_names: Iterable[str]) -> dict[str, Any]:
    """The lifecycle_msgs/msg/State of each node, or the exception of its call."""
    requests: dict[str, dict[str, Any]] = {name: {} for name in node_names}
    return _call(node, "GetState", "get_state", requests, lambda name, response: response.current_state)


def call_get_available_transitions(*, node: Node, states: Mapping[str, Any]) -> dict[str, Any]:
    """The transitions of each node, or the exception of its call.

    They are lifecycle_msgs/msg/TransitionDescription. `states` chooses transitions by the state in which they
    start; None: all transitions that are possible now.
    """
    return _transitions(node, "get_available_transitions", states)


def call_get_transition_graph(*, node: Node, states: Mapping[str, Any]) -> dict[str, Any]:
    """As `call_get_available_transitions`, but of the whole state machine."""
    return _transitions(node, "get_transition_graph", states)


def call_change_states(*, node: Node, transitions: Mapping[str, Any]) -> dict[str, Any]:
    """Request a lifecycle_msgs/msg/Transition of each node; whether it succeeded, or the exception."""
    requests = {name: {"transition": transition} for name, transition in transitions.items()}
    return _call(node, "ChangeState", "change_state", requests, lambda name, response: response.success)


def _transitions(node: Node, service: str, states: Mapping[str, Any]) -> dict[str, Any]:
    def chosen(name: str, response: Any) -> list[Any]:
        return [
            one
            for one in response.available_transitions
            if states[name] is None or one.start_state == states[name]
        ]

    requests: dict[str, dict[str, Any]] = {name: {} for name in states}
    return _call(node, "GetAvailableTransitions", service, requests, chosen)


def _call(
    node: Node,
    type_name: str,
    service: str,
    requests: Mapping[str, dict[str, Any]],
    result: Callable[[str, Any], Any],
) -> dict[str, Any]:
    """Call a service of several nodes, each as soon as it is there; the result of each, or its exception."""
    cls: Any = service_class(f"lifecycle_msgs/srv/{type_name}")
    clients = {name: node.create_client(cls, f"{name}/{service}") for name in requests}
    try:
        futures = {}
        for name, client in clients.items():
            client.wait_for_service()
            futures[name] = client.call_async(cls.Request(**requests[name]))
        for future in futures.values():
            rclpy.spin_until_future_complete(node, future)
        return {
            name: future.exception() or (result(name, future.result()) if future.done() else None)
            for name, future in futures.items()
        }
    finally:
        for client in clients.values():
            node.destroy_client(client)
