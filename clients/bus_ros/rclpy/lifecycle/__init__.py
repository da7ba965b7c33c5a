"""Lifecycle nodes: nodes that other programs configure, activate and shut down.

`Node`, `NodeMixin`, `State` and `Publisher` are short names, which `import *` leaves out: a program may have
imported another Node.

    `services.py` (requests) --> `node.py` --> `state_machine.py` (pure: the next state)
                                      +--> callbacks, then `managed_entity.py`, `publisher.py`

Invariants:

- States, transitions, their ids and labels are ROS 2's, and change only by `state_machine.py`.
- A callback that fails or raises leads to the state that ROS 2 prescribes.
- A publisher of a node that is not active publishes nothing.

Read first: `state_machine.py`. Tests: `tests/unit/bus_ros/rclpy/lifecycle/`,
`tests/system/test_rclpy_lifecycle.py`.
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
