"""Services of an AsyncNode: a native server, and the requests that wait for their turn."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from typing import Any, Final

from bus.endpoint.endpoint import core_of
from bus.names import reply_topic, request_topic
from bus.node import Node as NativeNode
from bus.service.server import RequestId, ServiceServer
from bus.types.service import service_support
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner, End, current_task
from bus_ros.rclpy.impl.native_node import service_qos
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.service import MOST_WAITING, BaseService

__all__ = ["AsyncService"]

MOST_AT_ONCE: Final = 1000
"""The most callbacks of a concurrent service at a time; further requests wait."""


class AsyncService(AsyncEntity, BaseService):
    """Made by `AsyncNode.create_service`.

    An `async def` callback answers one request after the other, or with `concurrent` each in its own
    task. At most 1000 requests wait; above this limit, the oldest are refused.
    """

    def __init__(
        self,
        owner: AsyncOwner,
        srv_type: Any,
        srv_name: str,
        service_name: str,
        callback: Callable[[Any, Any], Any],
        qos_profile: QoSProfile,
        *,
        concurrent: bool,
    ) -> None:
        AsyncEntity.__init__(self, owner)
        BaseService.__init__(self, srv_type, srv_name, callback, qos_profile, nullcontext())
        self._service_name = service_name
        self._waiting: deque[tuple[object, RequestId]] = deque()
        self._most_at_once = MOST_AT_ONCE if concurrent else 1
        self._calls: set[asyncio.Task[Any]] = set()
        """The running calls of an async callback."""

    @property
    def service_name(self) -> str:
        return self._service_name

    def ends(self) -> Iterable[End]:
        support, qos = service_support(self.srv_type), service_qos(self.qos_profile)
        yield "publisher", reply_topic(self._service_name), support.replies(b""), qos
        yield "subscription", request_topic(self._service_name), support.requests, qos

    # --- inside

    def _read_topic(self) -> str:
        return request_topic(self._service_name)

    async def _open(self, native_node: NativeNode) -> None:
        self.native: ServiceServer = await native_node.create_service(
            self.srv_type, self.srv_name, qos=service_qos(self.qos_profile), on_request=self._on_request
        )

    def _became_open(self) -> None:
        self._take_waiting()  # a request may come before the native server is returned

    def _stop(self) -> None:
        self._waiting.clear()
        for task in self._calls - {current_task()}:
            task.cancel()
        self.forget_events()

    async def _close(self) -> None:
        await self.native.close()

    def _on_request(self, request: object, request_id: RequestId) -> None:
        if len(self._waiting) >= MOST_WAITING:
            _, oldest = self._waiting.popleft()
            self._refuse(oldest, RuntimeError("too many requests wait"))
        self._waiting.append((request, request_id))
        if hasattr(self, "native"):
            self._take_waiting()

    def _take_waiting(self) -> None:
        """Begin calls for waiting requests, as many as may run."""
        while self._waiting and len(self._calls) < self._most_at_once and not self.is_destroyed:
            request, request_id = self._waiting.popleft()
            if core_of(self.native).skip(request_id):
                continue
            if not self.is_async:
                self._report_and_answer(self._answer, request, request_id)
                continue
            work = self._report_and_answer(self._answer_async, request, request_id)
            task = self._owner.run_in_group(work)
            if task is None:
                return
            self._calls.add(task)
            task.add_done_callback(self._called)

    def _called(self, task: "asyncio.Task[Any]") -> None:
        self._calls.discard(task)
        self._take_waiting()

    def _answer_with(self, response: object, request_id: RequestId) -> None:
        if not self.is_destroyed:  # the callback may have destroyed it: the client learns that
            super()._answer_with(response, request_id)
