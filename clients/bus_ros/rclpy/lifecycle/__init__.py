"""Managed nodes, which busd does not have: programs can import the names, and are told what is missing."""

from bus_ros.rclpy.lifecycle.node import (
    LifecycleNode,
    LifecyclePublisher,
    LifecycleState,
    Node,
    Publisher,
    State,
    TransitionCallbackReturn,
)

__all__ = [
    "LifecycleNode",
    "LifecyclePublisher",
    "LifecycleState",
    "Node",
    "Publisher",
    "State",
    "TransitionCallbackReturn",
]
