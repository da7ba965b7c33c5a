"""rclpy.action: servers and clients of actions, and the graph of actions.

Goals, their states and the endpoints come from `bus_actions`. `entity.py` queues calls for an executor;
`server.py` and `client.py` have rclpy's classes, handles and futures; `graph.py` rclpy's questions about
actions.

Invariants:

- A server or client is one entity in one callback group: all its callbacks respect that group.
- The queue is bounded: feedback by its QoS, requests by a constant.
- A state changes only by the table of `bus_actions.goal_state`.

Read first: `entity.py`, then `server.py`. Tests: `tests/system/test_rclpy_actions.py`,
`tests/unit/bus_actions/`.
"""

from bus_ros.rclpy.action.client import ActionClient
from bus_ros.rclpy.action.graph import (
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from bus_ros.rclpy.action.server import ActionServer, CancelResponse, GoalResponse

__all__ = [
    "ActionClient",
    "ActionServer",
    "CancelResponse",
    "GoalResponse",
    "get_action_client_names_and_types_by_node",
    "get_action_names_and_types",
    "get_action_server_names_and_types_by_node",
]
