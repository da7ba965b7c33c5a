"""`bus run turtle_tf2_py turtle_tf2_broadcaster`: a turtle's place, as a frame below `world`.

The parameter `turtlename` names the turtle.
"""

from math import cos, isfinite, sin
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_tf2.messages import message, message_type
from bus_tf2.programs.shell import begun
from bus_tf2.tf2_ros import TransformBroadcaster

__all__ = ["FramePublisher", "main"]


class FramePublisher(Node):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtle_tf2_frame_publisher", **options)
        self.turtlename: str = self.declare_parameter("turtlename", "turtle").value
        self.tf_broadcaster = TransformBroadcaster(self)
        pose = message_type("turtlesim/msg/Pose")
        self.create_subscription(pose, f"/{self.turtlename}/pose", self._place, 1)

    def _place(self, pose: Any) -> None:
        if not isfinite(pose.theta):
            return
        found = message("geometry_msgs/msg/TransformStamped", child_frame_id=self.turtlename)
        found.header.stamp = self.get_clock().now().to_msg()
        found.header.frame_id = "world"
        found.transform.translation.x, found.transform.translation.y = pose.x, pose.y
        found.transform.rotation.z, found.transform.rotation.w = sin(pose.theta / 2), cos(pose.theta / 2)
        self.tf_broadcaster.sendTransform(found)


def main() -> int:
    with begun():
        rclpy.spin(FramePublisher())
    return 0
