"""Answers look-ups of programs that do not receive transforms themselves.

Owns: the action, and the waiting time of a look-up. Must not know: the client (`BufferClient`).
"""

from typing import Any

from bus_ros.rclpy.action import ActionServer
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rosidl import action_class
from bus_tf2.messages import message
from bus_tf2.tf2_py import TransformException
from bus_tf2.tf2_ros.buffer import Buffer
from bus_tf2.tf2_ros.buffer_client import ERRORS

__all__ = ["BufferServer"]


class BufferServer:
    """Serves the look-ups of `buffer` as the action `ns`; each question waits for itself."""

    def __init__(self, buffer: Buffer, node: Node, ns: str = "tf2_buffer_server") -> None:
        self._buffer, self._node = buffer, node
        self._group = ReentrantCallbackGroup()
        kind = action_class("tf2_msgs/action/LookupTransform")
        self._server = ActionServer(node, kind, ns, self._answer, callback_group=self._group)

    def destroy(self) -> None:
        self._server.destroy()

    async def _answer(self, handle: Any) -> Any:
        goal = handle.request
        simple = (goal.target_frame, goal.source_frame, goal.source_time)
        full = (goal.target_frame, goal.target_time, goal.source_frame, goal.source_time, goal.fixed_frame)
        buffer = self._buffer
        wait = buffer.wait_for_transform_full_async if goal.advanced else buffer.wait_for_transform_async
        future = wait(*(full if goal.advanced else simple))
        timeout_s = Duration.from_msg(goal.timeout).nanoseconds / 1e9
        if timeout_s > 0 and not future.done():
            timer = self._node.create_timer(timeout_s, future.cancel, callback_group=self._group)
            await future
            self._node.destroy_timer(timer)
        future.cancel()
        result = message("tf2_msgs/action/LookupTransform_Result")
        try:
            look_up: Any = (
                buffer.lookup_transform_full_core if goal.advanced else buffer.lookup_transform_core
            )
            result.transform = look_up(*(full if goal.advanced else simple))
        except TransformException as error:
            result.error.error = ERRORS.index(type(error)) + 1
            result.error.error_string = str(error)
        handle.succeed()
        return result
