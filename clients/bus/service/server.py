"""Servers of services, as users see them; `bus.service.server_core` does the work."""

from collections.abc import Callable
from typing import Any

from bus.base.awaited import done_anyway
from bus.endpoint.core import NodeContext
from bus.qos import QoSProfile
from bus.service.base import ServiceBase
from bus.service.server_core import RequestId as RequestId
from bus.service.server_core import ServerCore
from bus.service.server_core import ServiceServerStatistics as ServiceServerStatistics


class ServiceServer(ServiceBase):
    """Serves one service; made by `Node.create_service`.

    `callback` is called for each request; its result is the answer. `on_request` instead is called with the
    request and its RequestId, and the program calls `respond` later. An `async def on_request` gets the next
    request after it has finished the current one.

    If a client died before its request's turn, the request is skipped and counted. It delays no living
    client.

        server = await node.create_service(AddTwoInts, "later", on_request=start_work)
    """

    _core: ServerCore

    def __init__(
        self,
        node: NodeContext,
        service: str,
        service_type: Any,
        qos: QoSProfile,
        *,
        callback: Callable[..., Any] | None = None,
        on_request: Callable[[Any, RequestId], Any] | None = None,
    ) -> None:
        super().__init__(
            ServerCore(node, service, service_type, qos, callback=callback, on_request=on_request)
        )

    def respond(self, request_id: RequestId, response: Any, error: str = "") -> bool:
        """Answer a request with `response`, or with `error` if that is not empty; from any thread.

        A second answer to a request has no effect, nor has an answer to a departed client. Returns False if
        there was no room (QoS keep all), as `Publisher.publish` does. Raises MessageTypeError for a wrong
        response, PayloadTooLarge above the limit, ConnectionClosed after `close`.
        """
        return self._core.respond(request_id, response, error)

    async def wait_for_room(self) -> None:
        """After `respond` found no room: wait until a new attempt may succeed.

        Raises ConnectionClosed if the server is closed meanwhile. Cancellation leaves nothing behind.
        """
        await self._core.replies.wait_for_room()

    def statistics(self) -> ServiceServerStatistics:
        """Its counters until now; `close` keeps them."""
        return self._core.statistics()

    @done_anyway
    async def close(self) -> None:
        """Take no more requests, hand over the answers, leave the graph. Closing twice is allowed.

        Callbacks that still run are cancelled; their clients get ServiceUnavailable.
        """
        await self._core.close()
