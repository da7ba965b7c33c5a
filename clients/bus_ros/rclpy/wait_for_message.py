"""Waiting for a single message, without an executor."""

from typing import TYPE_CHECKING, TypeVar

from bus_ros.rclpy.qos import QoSProfile, to_native

if TYPE_CHECKING:
    from bus_ros.rclpy.node import Node

__all__ = ["wait_for_message"]

M = TypeVar("M")


def wait_for_message(
    msg_type: type[M],
    node: "Node",
    topic: str,
    *,
    qos_profile: QoSProfile | int = 1,
    time_to_wait: float = -1,
) -> tuple[bool, M | None]:
    """Wait for a message on `topic`, `time_to_wait` seconds at most (negative: for ever).

    Returns whether it came, and the message.
    """
    return node.receive_one(
        msg_type, topic, to_native(qos_profile), None if time_to_wait < 0 else time_to_wait
    )
