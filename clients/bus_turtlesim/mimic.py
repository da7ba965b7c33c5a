"""`bus run turtlesim mimic`: one turtle moves as another does.

It hears `input/pose` and tells `output/cmd_vel`; remap both.
"""

from contextlib import suppress
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.executors import ExternalShutdownException
from bus_ros.rclpy.node import Node
from bus_turtlesim.messages import Pose, Twist

__all__ = ["Mimic", "main"]


class Mimic(Node):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtle_mimic", **options)
        self._commands = self.create_publisher(Twist, "output/cmd_vel", 1)
        self.create_subscription(Pose, "input/pose", self._follow, 1)

    def _follow(self, pose: Any) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = pose.linear_velocity, pose.angular_velocity
        self._commands.publish(twist)


def main() -> int:
    with rclpy.init(), suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Mimic())
    return 0
