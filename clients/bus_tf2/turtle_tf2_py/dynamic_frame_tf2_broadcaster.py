"""`bus run turtle_tf2_py dynamic_frame_tf2_broadcaster`: `carrot1`, which goes round `turtle1` at 10 m."""

from math import cos, pi, sin
from typing import Any

import bus_ros.rclpy as rclpy
from bus_tf2.programs.shell import begun
from bus_tf2.turtle_tf2_py.carrots import Carrot

__all__ = ["DynamicFrameBroadcaster", "main"]


class DynamicFrameBroadcaster(Carrot):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("dynamic_frame_tf2_broadcaster", _place, **options)


def _place(time_s: float) -> tuple[float, float]:
    """As in ROS 2 by whole seconds, each half a round."""
    angle = int(time_s) % 2 * pi
    return 10 * sin(angle), 10 * cos(angle)


def main() -> int:
    with begun():
        rclpy.spin(DynamicFrameBroadcaster())
    return 0
