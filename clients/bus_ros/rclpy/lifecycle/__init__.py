"""Lifecycle nodes: nodes that others configure, activate and shut down.

`Node`, `NodeMixin`, `State` and `Publisher` are short names, which `import *` leaves out: another Node may
be there.
"""

from bus_ros.rclpy.lifecycle.managed_entity import (
    ManagedEntity,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)
from bus_ros.rclpy.lifecycle.node import (
    LifecycleNode,
    LifecycleNodeMixin,
    LifecycleState,
)
from bus_ros.rclpy.lifecycle.publisher import LifecyclePublisher

__all__ = [
    "LifecycleNode",
    "LifecycleNodeMixin",
    "LifecyclePublisher",
    "LifecycleState",
    "ManagedEntity",
    "SimpleManagedEntity",
    "TransitionCallbackReturn",
]

Node = LifecycleNode
NodeMixin = LifecycleNodeMixin
State = LifecycleState
Publisher = LifecyclePublisher
