"""Asks a buffer server for transforms: a program need not receive all transforms itself.

Owns: the goal of each look-up, and the exception for each answer. Must not know: the server's program
(`bus run tf2_ros buffer_server`).
"""

import threading
from time import monotonic
from typing import Any

from bus_ros.rclpy.action import ActionClient
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from bus_ros.rosidl import action_class
from bus_tf2.messages import message
from bus_tf2.tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from bus_tf2.tf2_ros.buffer_interface import BufferInterface

__all__ = ["BufferClient"]

ERRORS: list[type[TransformException]] = [
    LookupException,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    TimeoutException,
    TransformException,
]
"""Exceptions, in order of the number in a TF2Error, from 1."""


class BufferClient(BufferInterface):
    """Look-ups by the action `ns`, `tf2_buffer_server` as a rule.

    They block, and need another thread that spins the node. `timeout_padding`: how much longer than its own
    time-out a question waits for the server. `check_frequency` does nothing.
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float | None = None,
        timeout_padding: Duration = Duration(seconds=2.0),  # noqa: B008
    ) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, action_class("tf2_msgs/action/LookupTransform"), ns)
        self.timeout_padding = timeout_padding

    def destroy(self) -> None:
        self.action_client.destroy()

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Whether there is a server, within `timeout_sec`."""
        return self.action_client.wait_for_server(timeout_sec)

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """As Buffer's, with the same exceptions. Raises TimeoutException if the server does not answer."""
        return self._ask(
            timeout, target_frame=target_frame, source_frame=source_frame, source_time=_message(time)
        )

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """As Buffer's; errors as above."""
        return self._ask(
            timeout,
            target_frame=target_frame,
            source_frame=source_frame,
            source_time=_message(source_time),
            target_time=_message(target_time),
            fixed_frame=fixed_frame,
            advanced=True,
        )

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException:
            return False
        return True

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> bool:
        try:
            self.lookup_transform_full(
                target_frame, target_time, source_frame, source_time, fixed_frame, timeout
            )
        except TransformException:
            return False
        return True

    def _ask(self, timeout: Duration, **fields: Any) -> Any:
        deadline = monotonic() + (timeout + self.timeout_padding).nanoseconds / 1e9
        goal = message("tf2_msgs/action/LookupTransform_Goal", timeout=timeout.to_msg(), **fields)
        handle = _result_of(self.action_client.send_goal_async(goal), deadline)
        if not handle.accepted:
            raise TransformException("The goal was not accepted by the buffer server")
        result = _result_of(handle.get_result_async(), deadline).result
        if number := result.error.error:
            raise ERRORS[min(number, len(ERRORS)) - 1](result.error.error_string)
        return result.transform


def _message(time: Any) -> Any:
    return time.to_msg() if hasattr(time, "to_msg") else time


def _result_of(future: Future[Any], deadline: float) -> Any:
    done = threading.Event()
    future.call_when_done(done.set)
    if not done.wait(min(max(deadline - monotonic(), 0.0), threading.TIMEOUT_MAX)):
        raise TimeoutException("The buffer server did not answer in time")
    return future.result()
