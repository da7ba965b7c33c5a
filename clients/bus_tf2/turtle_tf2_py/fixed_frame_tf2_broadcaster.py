"""`bus run turtle_tf2_py fixed_frame_tf2_broadcaster`: `carrot1`, two metres to the left of `turtle1`."""

from typing import Any

import bus_ros.rclpy as rclpy
from bus_tf2.programs.shell import begun
from bus_tf2.turtle_tf2_py.carrots import Carrot

__all__ = ["FixedFrameBroadcaster", "main"]


class FixedFrameBroadcaster(Carrot):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("fixed_frame_tf2_broadcaster", lambda time_s: (0.0, 2.0), **options)


def main() -> int:
    with begun():
        rclpy.spin(FixedFrameBroadcaster())
    return 0
