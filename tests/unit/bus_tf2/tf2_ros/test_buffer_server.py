"""The buffer server's wait for a transform, without a node."""

from typing import Any, cast
from unittest.mock import Mock

from bus_ros.rclpy.duration import Duration
from bus_tf2.messages import message
from bus_tf2.tf2_ros import Buffer
from bus_tf2.tf2_ros.buffer_server import BufferServer
from tf2_world import transform


def test_the_timer_of_a_look_up_ends_with_its_wait() -> None:
    server = object.__new__(BufferServer)
    server._buffer, server._node = Buffer(), cast(Any, Mock())
    server._group = Mock()
    node: Any = server._node
    goal = message("tf2_msgs/action/LookupTransform_Goal", target_frame="a", source_frame="b")
    goal.timeout = Duration(seconds=1).to_msg()
    answer = server._answer(Mock(request=goal))
    answer.send(None)
    node.destroy_timer.assert_not_called()
    server._buffer.set_transform_static(transform("a", "b", moved=(1, 0, 0)), "me")
    try:
        answer.send(None)
    except StopIteration as end:
        assert end.value.transform.transform.translation.x == 1.0
    node.destroy_timer.assert_called_once_with(node.create_timer.return_value)
    assert server._buffer._new_data_callbacks == []
