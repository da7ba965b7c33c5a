"""`bus run turtle_tf2_py turtle_tf2_message_broadcaster`: a third turtle, which goes round in circles.

It publishes its place on `turtle3/turtle_point_stamped`, as a point in `world`.
"""

from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.node import Node
from bus_tf2.messages import message, message_type
from bus_tf2.programs.shell import begun
from bus_tf2.turtle_tf2_py.spawner import Spawner

__all__ = ["PointPublisher", "main"]


class PointPublisher(Node):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("turtle_tf2_message_broadcaster", **options)
        self._commands = self.create_publisher(message_type("geometry_msgs/msg/Twist"), "turtle3/cmd_vel", 10)
        self._points = self.create_publisher(
            message_type("geometry_msgs/msg/PointStamped"), "turtle3/turtle_point_stamped", 10
        )
        self.create_subscription(message_type("turtlesim/msg/Pose"), "turtle3/pose", self._broadcast, 10)
        self._spawner = Spawner(self, "turtle3")
        self.create_timer(1.0, self._spawner.is_there)

    def _broadcast(self, pose: Any) -> None:
        twist = message("geometry_msgs/msg/Twist")
        twist.linear.x = twist.angular.z = 1.0
        self._commands.publish(twist)
        point = message("geometry_msgs/msg/PointStamped")
        point.header.stamp = self.get_clock().now().to_msg()
        point.header.frame_id = "world"
        point.point.x, point.point.y = pose.x, pose.y
        self._points.publish(point)


def main() -> int:
    with begun():
        rclpy.spin(PointPublisher())
    return 0
