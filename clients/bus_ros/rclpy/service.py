"""Services of the facade: a native server, and a queue of requests until an executor takes them."""

from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from bus.base.callbacks import is_async
from bus.endpoint.endpoint import core_of
from bus.service.server import RequestId, ServiceServer
from bus_ros.engine import Engine
from bus_ros.entity import Entity, Group, Owner, Work
from bus_ros.rclpy.destroyable import Destroyable
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.impl.introspected import Introspected
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.service_introspection import ServiceIntrospectionState

__all__ = ["BaseService", "Service", "ServiceIntrospectionState"]

MOST_WAITING = 1000
"""Requests that wait for an executor; above this limit, the oldest are refused."""


class BaseService(Introspected, Destroyable):
    """Base of `Service` and of `rclpy.experimental.AsyncService`: the answers.

    `guard` is entered around each use of the native server.
    """

    native: ServiceServer
    is_destroyed: bool

    def __init__(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        qos_profile: QoSProfile,
        guard: AbstractContextManager[None],
    ) -> None:
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.callback = callback
        self.qos_profile = qos_profile
        self.is_async = is_async(callback)
        self._guard = guard

    @property
    def service_name(self) -> str:
        return self.native.service_name

    def send_response(self, response: object, header: RequestId) -> None:
        """Answer the request that came with `header`.

        Raises TypeError if `response` is not a response of the service, InvalidHandle once the service is
        destroyed.
        """
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(
                f"the callback of service '{self.service_name}' must return"
                f" a {self.srv_type.Response.__name__}, not {type(response).__name__}"
            )
        if self._respond(header, response) and self.events is not None:
            self.events.publish_event("RESPONSE_SENT", header.client, header.number, response=response)

    def _report_and_answer(self, answer: Callable[..., Any], request: object, request_id: RequestId) -> Any:
        if self.events is not None:
            self.events.publish_event("REQUEST_RECEIVED", *request_id, request=request)
        return answer(request, request_id)

    def _answer(self, request: object, request_id: RequestId) -> None:
        try:
            response = self.callback(request, self.srv_type.Response())
            self._answer_with(response, request_id)
        except Exception as error:
            self._refuse(request_id, error)
            raise

    async def _answer_async(self, request: object, request_id: RequestId) -> None:
        try:
            response = await self.callback(request, self.srv_type.Response())
            self._answer_with(response, request_id)
        except Exception as error:
            self._refuse(request_id, error)
            raise

    def _answer_with(self, response: object, request_id: RequestId) -> None:
        self.send_response(response, request_id)

    def _refuse(self, request_id: RequestId, error: Exception) -> None:
        """Answer with an error; in ROS the client would wait for ever."""
        with self._guard:
            # The callback may have destroyed it. A flood of requests may come before it is open.
            if not self.is_destroyed and hasattr(self, "native"):
                core_of(self.native).refuse(request_id, error)

    def _respond(self, request_id: RequestId, response: object) -> bool:
        """Returns False if the client gets an error instead, because the response is too large."""
        with self._guard:
            if self.is_destroyed:
                raise InvalidHandle(f"the service '{self.service_name}' is destroyed")
            return core_of(self.native).answer(request_id, response)


class Service(Entity, BaseService):
    """Made by `Node.create_service`."""

    rank = 5

    def __init__(
        self,
        engine: Engine,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        callback_group: Group,
        qos_profile: QoSProfile,
        node: Owner,
    ) -> None:
        BaseService.__init__(self, srv_type, srv_name, callback, qos_profile, engine.loop)
        self._waiting: deque[tuple[object, RequestId]] = deque()
        Entity.__init__(self, node, callback_group)
        self.is_queued = True  # until `begin`: no executor takes earlier requests

    def begin(self, native: ServiceServer) -> None:
        """For the node: `native` is made, and answers can be sent. Requests may have arrived before."""
        self.native = native
        self.is_queued = False

    def destroy(self) -> None:
        """Stop taking requests."""
        self.node.destroy_service(self)

    # --- for the executor and the native server, under the guard

    def on_request(self, request: object, request_id: RequestId) -> None:
        if len(self._waiting) >= MOST_WAITING:
            _, oldest = self._waiting.popleft()
            self._refuse(oldest, RuntimeError("too many requests wait: nobody spins the server"))
        self._waiting.append((request, request_id))
        self.notify()

    def take(self, most: int) -> Work | None:
        while self._waiting:
            request, request_id = self._waiting.popleft()
            if core_of(self.native).skip(request_id):
                continue
            answer = self._answer_async if self.is_async else self._answer
            if self.events is not None:
                return self._report_and_answer, (answer, request, request_id)
            return answer, (request, request_id)
        return None
