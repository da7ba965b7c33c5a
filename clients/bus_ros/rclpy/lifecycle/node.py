"""The names of rclpy.lifecycle.node; making a node of them says that lifecycles are missing."""

from enum import IntEnum
from typing import NamedTuple

__all__ = [
    "LifecycleNode",
    "LifecyclePublisher",
    "LifecycleState",
    "Node",
    "Publisher",
    "State",
    "TransitionCallbackReturn",
]


class TransitionCallbackReturn(IntEnum):
    """How a transition went; numbers are those of lifecycle_msgs/msg/Transition."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99


class LifecycleState(NamedTuple):
    """A state of a managed node."""

    label: str
    state_id: int


class LifecycleNode:
    """Would be a node that others configure, activate and shut down."""

    def __init__(self, node_name: str = "", **_: object) -> None:
        raise NotImplementedError(
            f"busd has no lifecycle nodes yet, so '{node_name}' can't be one: "
            "use rclpy.node.Node and do in its constructor what on_configure and on_activate do"
        )


class LifecyclePublisher:
    """Would publish while its node is active."""

    def __init__(self, *_: object, **__: object) -> None:
        raise NotImplementedError("busd has no lifecycle nodes yet: use rclpy.node.Node's create_publisher")


Node = LifecycleNode
State = LifecycleState
Publisher = LifecyclePublisher
