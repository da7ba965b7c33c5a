"""`bus run turtle_tf2_py static_turtle_tf2_broadcaster`: a frame below `world` that does not move.

static_turtle_tf2_broadcaster child_frame_name x y z roll pitch yaw
"""

from collections.abc import Sequence
from typing import Any

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.logging import get_logger
from bus_ros.rclpy.node import Node
from bus_tf2.messages import message
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.tf2_ros import StaticTransformBroadcaster
from bus_tf2.tf_transformations import quaternion_from_euler

__all__ = ["StaticFramePublisher", "main"]

_USAGE = (
    "Invalid number of parameters. Usage: \n"
    "$ ros2 run turtle_tf2_py static_turtle_tf2_broadcaster child_frame_name x y z roll pitch yaw"
)
"""ROS 2's words."""


class StaticFramePublisher(Node):
    """The node; `numbers`: x, y, z, roll, pitch, yaw of the frame `name` in `world`."""

    def __init__(self, name: str, numbers: Sequence[float], **options: Any) -> None:
        super().__init__("static_turtle_tf2_broadcaster", **options)
        self.tf_static_broadcaster = StaticTransformBroadcaster(self)
        found = message("geometry_msgs/msg/TransformStamped", child_frame_id=name)
        found.header.stamp = self.get_clock().now().to_msg()
        found.header.frame_id = "world"
        place, turn = found.transform.translation, found.transform.rotation
        place.x, place.y, place.z, roll, pitch, yaw = numbers
        turn.x, turn.y, turn.z, turn.w = quaternion_from_euler(roll, pitch, yaw)
        self.tf_static_broadcaster.sendTransform(found)


def main() -> int:
    log = get_logger("logger")
    words = own_words()
    if len(words) != 7:
        log.info(_USAGE)
        return 1
    name, *texts = words
    if name == "world":
        log.info('Your static turtle name cannot be "world"')
        return 2
    try:
        numbers = [float(text) for text in texts]
    except ValueError as error:
        log.error(f"x y z roll pitch yaw are numbers: {error}")
        return 1
    with begun():
        rclpy.spin(StaticFramePublisher(name, numbers))
    return 0
