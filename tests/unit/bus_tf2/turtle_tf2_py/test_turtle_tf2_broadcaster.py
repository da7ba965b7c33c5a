"""The frame of a turtle, without a bus."""

from math import inf
from typing import Any
from unittest.mock import Mock

from bus_ros.rclpy.time import Time
from bus_tf2.messages import message
from bus_tf2.turtle_tf2_py.turtle_tf2_broadcaster import FramePublisher


def test_a_heading_that_is_not_finite_is_ignored() -> None:
    node: Any = object.__new__(FramePublisher)
    node.turtlename, node.tf_broadcaster = "turtle1", Mock()
    node.get_clock = Mock(return_value=Mock(now=Mock(return_value=Time())))
    for theta in (inf, 0.0):
        node._place(message("turtlesim/msg/Pose", theta=theta, x=2.0))
    (call,) = node.tf_broadcaster.sendTransform.call_args_list
    assert call.args[0].transform.translation.x == 2.0
