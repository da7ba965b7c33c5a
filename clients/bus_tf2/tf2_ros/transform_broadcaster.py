"""Sends transforms that change on `/tf`."""

from collections.abc import Iterable
from typing import Any

from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile
from bus_tf2.messages import message_type

__all__ = ["TransformBroadcaster", "as_list"]


class TransformBroadcaster:
    """`qos`: a profile, or a depth."""

    def __init__(self, node: Node, qos: QoSProfile | int = QoSProfile(depth=100)) -> None:  # noqa: B008
        self._message = message_type("tf2_msgs/msg/TFMessage")
        self.pub_tf = node.create_publisher(self._message, "/tf", qos)

    def sendTransform(self, transform: Any) -> None:
        """Send a TransformStamped, or several."""
        self.pub_tf.publish(self._message(transforms=as_list(transform)))


def as_list(transform: Any) -> list[Any]:
    """One transform or several, as a list."""
    if isinstance(transform, list):
        return transform
    return list(transform) if isinstance(transform, Iterable) else [transform]
