"""Clients of services of an AsyncNode: a native client, and an asyncio future for each call."""

import asyncio
from collections.abc import Iterable
from typing import Any

from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ConnectionClosed, ServiceUnavailable
from bus.names import reply_topic, request_topic
from bus.node import Node as NativeNode
from bus.service.client import ServiceClient
from bus.types.service import service_support
from bus_ros.rclpy.client import BaseClient
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner, End
from bus_ros.rclpy.impl.native_node import service_qos
from bus_ros.rclpy.impl.openings import Openings
from bus_ros.rclpy.qos import QoSProfile

__all__ = ["AsyncClient"]


class _Requests:
    """The handle of a client, for programs that send requests by it."""

    def __init__(self, client: "AsyncClient") -> None:
        self._client = client

    def send_request(self, request: object) -> int:
        """Send a request; returns its number. The program puts a future into `_pending_requests` for it."""
        return self._client._send(request)


class AsyncClient(AsyncEntity, BaseClient):
    """Made by `AsyncNode.create_client`."""

    def __init__(
        self, owner: AsyncOwner, srv_type: Any, srv_name: str, service_name: str, qos_profile: QoSProfile
    ) -> None:
        AsyncEntity.__init__(self, owner)
        BaseClient.__init__(self, srv_type, srv_name, qos_profile)
        self._service_name = service_name
        self._native: ServiceClient | None = None
        self._is_open = asyncio.Event()  # or destroyed
        self._pending_requests: dict[int, asyncio.Future[Any]] = {}
        """The key is the number of the request, as in rclpy: programs read it."""
        self._numbers: dict[int, int] = {}
        """The number of a request, by the native client's number."""
        self._native_numbers: dict[int, int] = {}
        """The reverse."""
        self._last_number = 0
        self._holds = 1  # until it is open
        self._unsent: dict[int, object] = {}
        """Requests by their number, while it holds them."""
        self._openings: Openings | None = None

    @property
    def handle(self) -> Any:
        """The handle of the client, which sends requests."""
        return _Requests(self)

    @property
    def service_name(self) -> str:
        return self._service_name

    async def call(self, request: object) -> Any:
        """Call the service and wait for the answer; a cancelled call is forgotten.

        Before the node runs, and while it or a server of this event loop is being made, the request waits.
        Has no time limit: use `asyncio.timeout`. Without a server it waits; see `wait_for_service`. If the
        client is destroyed meanwhile, it raises CancelledError.

        Raises TypeError if `request` is not a request of the service, RuntimeError after the client, or its
        node, was destroyed, or if the QoS is keep all and there is no room; ServiceError if the server's
        callback raised (in ROS 2 the call would wait for ever).
        """
        if self.is_destroyed:
            raise RuntimeError(f"the client of service '{self._service_name}' is destroyed")
        future: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        number = self._send(request)
        self._pending_requests[number] = future
        try:
            return await future
        finally:
            self._pending_requests.pop(number, None)
            self._forget(number)

    async def wait_for_service(self, *, check_interval: float = 0.1) -> None:
        """Wait for a server. Has no time limit: use `asyncio.timeout`.

        `check_interval` is ROS 2's, without effect: a change of the graph wakes it at once. Raises
        CancelledError if the client is destroyed meanwhile.
        """
        await self._is_open.wait()
        try:
            if self._native is not None and not self.is_destroyed:
                await self._native.wait_for_service()
                return
        except ConnectionClosed:
            pass
        raise asyncio.CancelledError(f"the client of service '{self._service_name}' is destroyed")

    def service_is_ready(self) -> bool:
        """Whether a server of the service exists; False before the node runs."""
        return self._native is not None and self._native.service_is_ready()

    def ends(self) -> Iterable[End]:
        support, qos = service_support(self.srv_type), service_qos(self.qos_profile)
        yield "subscription", reply_topic(self._service_name), support.replies(b""), qos
        yield "publisher", request_topic(self._service_name), support.requests, qos

    # --- for the node and its openings

    def begin(self, openings: Openings) -> None:
        super().begin(openings)
        if not self.is_destroyed:
            self._openings = openings
            openings.add_publisher(request_topic(self._service_name), self)

    def hold(self) -> None:
        self._holds += 1

    def release(self) -> None:
        self._holds -= 1
        if self._holds:
            return
        unsent, self._unsent = self._unsent, {}
        for number, request in unsent.items():
            try:
                self._send_now(number, request)
            except (BusError, RuntimeError) as error:
                self._settle(number, error)

    # --- inside

    async def _open(self, native_node: NativeNode) -> None:
        self._native = await native_node.create_client(
            self.srv_type, self.srv_name, service_qos(self.qos_profile), on_response=self._on_response
        )

    def _became_open(self) -> None:
        self.release()
        self._is_open.set()

    def _stop(self) -> None:
        if self._openings is not None:
            self._openings.remove_publisher(request_topic(self._service_name), self)
        self._is_open.set()
        self._unsent.clear()
        for future in self._pending_requests.values():
            future.cancel()
        self.forget_events()

    async def _close(self) -> None:
        if self._native is not None:
            await self._native.close()

    def _send(self, request: object) -> int:
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"expected a {self.srv_type.Request.__name__}, got {type(request).__name__}")
        self._last_number = number = self._last_number + 1
        if self._holds:
            self._unsent[number] = request
        else:
            self._send_now(number, request)
        return number

    def _send_now(self, number: int, request: object) -> None:
        assert self._native is not None
        native_number = self._native.send_request(request)
        if not native_number:
            raise RuntimeError(f"no room to call service '{self._service_name}'")
        self._numbers[native_number] = number
        self._native_numbers[number] = native_number
        if self.events is not None:
            self.events.publish_event("REQUEST_SENT", core_of(self._native).gid, number, request=request)

    def _forget(self, number: int) -> None:
        """Stop waiting for an answer."""
        self._unsent.pop(number, None)
        native_number = self._native_numbers.pop(number, None)
        if native_number is not None and self._native is not None:
            self._numbers.pop(native_number, None)
            self._native.forget(native_number)

    def _on_response(self, native_number: int, outcome: object) -> None:
        if isinstance(outcome, ServiceUnavailable):
            return  # as in ROS, a call stays open if its service has gone
        number = self._numbers.pop(native_number, None)
        if number is None:
            return
        self._native_numbers.pop(number, None)
        if self.events is not None and self._native is not None and not isinstance(outcome, BusError):
            self.events.publish_event(
                "RESPONSE_RECEIVED", core_of(self._native).gid, number, response=outcome
            )
        self._settle(number, outcome)

    def _settle(self, number: int, outcome: object) -> None:
        future = self._pending_requests.get(number)
        if future is None or future.done():
            return
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        else:
            future.set_result(outcome)
