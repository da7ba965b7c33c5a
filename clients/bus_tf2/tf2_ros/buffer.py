"""The buffer that listeners fill and programs ask, and waiting for a transform.

Owns: the look-ups that wait for new transforms. Must not know: topics, the source of transforms.
"""

import threading
from collections.abc import Callable
from time import monotonic
from typing import Any

from bus_ros.rclpy.clock import Clock, JumpThreshold, TimeJump
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.logging import get_logger
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.task import Future
from bus_ros.rosidl import service_class
from bus_tf2.tf2_py import BufferCore
from bus_tf2.tf2_ros.buffer_interface import BufferInterface

__all__ = ["Buffer"]


class Buffer(BufferCore, BufferInterface):
    """Transforms of the last seconds, with look-ups that can wait.

    `cache_time`: how long they are kept; None means 10 s. `node`: gets a service `tf2_frames` that returns
    all frames; its clock clears the buffer if simulated time jumps back.

    A look-up that waits blocks its thread. If that thread should also receive the transform (a callback of a
    single-threaded executor), the transform never arrives. In that case have the listener spin on its own
    (`spin_thread=True`), use a MultiThreadedExecutor, or await `lookup_transform_async`.
    """

    def __init__(self, cache_time: Duration | None = None, node: Node | None = None) -> None:
        BufferCore.__init__(self, cache_time)
        BufferInterface.__init__(self)
        self._new_data_callbacks: list[Callable[[], object]] = []
        self.clock = Clock() if node is None else node.get_clock()
        if node is not None:
            self.srv = node.create_service(
                service_class("tf2_msgs/srv/FrameGraph"), "tf2_frames", self._answer_frames
            )
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(seconds=-1), on_clock_change=True)
        self.jump_handle = self.clock.create_jump_callback(threshold, post_callback=self.time_jump_callback)

    def time_jump_callback(self, time_jump: TimeJump) -> None:
        get_logger("tf2_buffer").warning("Detected jump back in time. Clearing tf buffer.")
        self.clear()

    def set_transform(self, transform: Any, authority: str) -> None:
        super().set_transform(transform, authority)
        self._call_new_data_callbacks()

    def set_transform_static(self, transform: Any, authority: str) -> None:
        super().set_transform_static(transform, authority)
        self._call_new_data_callbacks()

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """The TransformStamped that takes coordinates in `source_frame` into `target_frame`.

        `time`: a Time; zero is the latest that both have. `timeout`: how long to wait until there is one.
        Raises LookupException, ConnectivityException, ExtrapolationException, InvalidArgumentException.
        """
        if timeout.nanoseconds > 0:
            self._wait(lambda: self.can_transform_core(target_frame, source_frame, time)[0], timeout)
        return self.lookup_transform_core(target_frame, source_frame, time)

    async def lookup_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """The same once it is there. Raises no error of a look-up, even if waiting does not help."""
        await self.wait_for_transform_async(target_frame, source_frame, time)
        return self.lookup_transform_core(target_frame, source_frame, time)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        """The transform from `source_frame` at one time into `target_frame` at another time.

        Uses a frame that does not move in between. Times and errors as above.
        """
        question = (target_frame, target_time, source_frame, source_time, fixed_frame)
        if timeout.nanoseconds > 0:
            self._wait(lambda: self.can_transform_full_core(*question)[0], timeout)
        return self.lookup_transform_full_core(*question)

    async def lookup_transform_full_async(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> Any:
        """The same once it is there."""
        question = (target_frame, target_time, source_frame, source_time, fixed_frame)
        await self.wait_for_transform_full_async(*question)
        return self.lookup_transform_full_core(*question)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether a look-up has an answer, within `timeout`; `return_debug_tuple`: and why not, as a text."""
        return self._ask(
            lambda: self.can_transform_core(target_frame, source_frame, time), timeout, return_debug_tuple
        )

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
        return_debug_tuple: bool = False,
    ) -> Any:
        """The same for `lookup_transform_full`."""
        question = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._ask(lambda: self.can_transform_full_core(*question), timeout, return_debug_tuple)

    def wait_for_transform_async(self, target_frame: str, source_frame: str, time: Any) -> Future[Any]:
        """A future; its result is the transform, once it is available."""
        question = (target_frame, source_frame, time)
        return self._future(
            lambda: self.can_transform_core(*question)[0], lambda: self.lookup_transform_core(*question)
        )

    def wait_for_transform_full_async(
        self, target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
    ) -> Future[Any]:
        """The same for `lookup_transform_full`."""
        question = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._future(
            lambda: self.can_transform_full_core(*question)[0],
            lambda: self.lookup_transform_full_core(*question),
        )

    def _ask(
        self, ask: Callable[[], tuple[int, str]], timeout: Duration, return_debug_tuple: bool
    ) -> int | tuple[int, str]:
        if timeout.nanoseconds > 0:
            self._wait(lambda: ask()[0], timeout)
        answer = ask()
        return answer if return_debug_tuple else answer[0]

    def _wait(self, is_there: Callable[[], int], timeout: Duration) -> None:
        """Block until it is there, or the time is over."""
        deadline = monotonic() + timeout.nanoseconds / 1e9
        news = threading.Event()
        self._new_data_callbacks.append(news.set)
        try:
            while not is_there() and (left_s := deadline - monotonic()) > 0:
                news.wait(min(left_s, threading.TIMEOUT_MAX))
                news.clear()
        finally:
            self._new_data_callbacks.remove(news.set)

    def _future(self, is_there: Callable[[], int], look_up: Callable[[], Any]) -> Future[Any]:
        future: Future[Any] = Future()

        def check() -> None:
            try:
                if not future.done() and is_there():
                    future.set_result(look_up())
            except Exception as error:
                future.set_exception(error)

        self._new_data_callbacks.append(check)
        future.add_done_callback(lambda _: self._new_data_callbacks.remove(check))
        check()
        return future

    def _call_new_data_callbacks(self) -> None:
        if self._new_data_callbacks:
            for callback in self._new_data_callbacks.copy():
                callback()

    def _answer_frames(self, request: Any, response: Any) -> Any:
        response.frame_yaml = self.all_frames_as_yaml()
        return response
