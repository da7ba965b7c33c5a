"""`bus run turtle_tf2_py turtle_tf2_listener`: a second turtle, which follows a frame.

The parameter `target_frame` names the frame; the default is the frame of `turtle1`.
"""

from math import atan2, hypot
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message_type
from bus_tf2.programs.shell import begun
from bus_tf2.tf2_ros import Buffer, TransformException, TransformListener
from bus_tf2.turtle_tf2_py.spawner import Spawner

__all__ = ["FrameListener", "main"]

_TURN, _SPEED = 1.0, 0.5
"""Per second, for each rad and each metre that are missing."""


class FrameListener(Node):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtle_tf2_frame_listener", **options)
        self.target_frame: str = self.declare_parameter("target_frame", "turtle1").value
        self.tf_buffer = Buffer()
        self.tf_listener = TransformListener(self.tf_buffer, self)
        self._twist = message_type("geometry_msgs/msg/Twist")
        self._commands = self.create_publisher(self._twist, "turtle2/cmd_vel", 1)
        self._spawner = Spawner(self, "turtle2")
        self.create_timer(1.0, self._follow)

    def _follow(self) -> None:
        if not self._spawner.is_there():
            return
        try:
            found = self.tf_buffer.lookup_transform("turtle2", self.target_frame, Time())
        except TransformException as error:
            self.get_logger().info(f"Could not transform turtle2 to {self.target_frame}: {error}")
            return
        way, twist = found.transform.translation, self._twist()
        twist.angular.z = _TURN * atan2(way.y, way.x)
        twist.linear.x = _SPEED * hypot(way.x, way.y)
        self._commands.publish(twist)


def main() -> int:
    with begun():
        rclpy.spin(FrameListener())
    return 0
