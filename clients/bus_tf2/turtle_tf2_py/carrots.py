"""A frame `carrot1` beside `turtle1`, for the turtle that follows it."""

from collections.abc import Callable
from typing import Any

from bus_ros.rclpy.node import Node
from bus_tf2.messages import message
from bus_tf2.tf2_ros import TransformBroadcaster

__all__ = ["Carrot"]

_PERIOD_S = 0.1


class Carrot(Node):
    """`place` is a function of the time in seconds; it returns x and y, seen from the turtle."""

    def __init__(self, name: str, place: Callable[[float], tuple[float, float]], **options: Any) -> None:
        super().__init__(name, **options)
        self._place = place
        self.tf_broadcaster = TransformBroadcaster(self)
        self.create_timer(_PERIOD_S, self._broadcast)

    def _broadcast(self) -> None:
        now = self.get_clock().now()
        found = message("geometry_msgs/msg/TransformStamped", child_frame_id="carrot1")
        found.header.stamp = now.to_msg()
        found.header.frame_id = "turtle1"
        found.transform.translation.x, found.transform.translation.y = self._place(now.nanoseconds / 1e9)
        self.tf_broadcaster.sendTransform(found)
