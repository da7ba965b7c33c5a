"""Clients of services, as users see them; `bus.service.client_core` does the work."""

import asyncio
from collections.abc import Callable
from typing import Any

from bus.base.awaited import done_anyway
from bus.endpoint.core import NodeContext
from bus.errors import BusError, LocalProtocolError, again
from bus.qos import QoSProfile
from bus.service.base import ServiceBase
from bus.service.client_core import ClientCore
from bus.service.client_core import ServiceClientStatistics as ServiceClientStatistics


class ServiceClient(ServiceBase):
    """Calls one service; made by `Node.create_client`.

    `on_response` is for calls by `send_request`. It is called on the event loop with the request's number,
    and with the response or an error (a BusError).

        response = await client.call(AddTwoInts.Request(a=1, b=2))
    """

    _core: ClientCore

    def __init__(
        self,
        node: NodeContext,
        service: str,
        service_type: Any,
        qos: QoSProfile,
        *,
        on_response: Callable[[int, Any], object] | None = None,
    ) -> None:
        super().__init__(ClientCore(node, service, service_type, qos))
        self._on_response = on_response

    async def call(self, request: Any) -> Any:
        """Send `request` and wait for its answer, without a time limit: use `asyncio.timeout`.

        Raises the errors of `Publisher.publish`, and:

        - ServiceUnavailable: no server exists, the server left before its answer, or the call was lost with
          busd or by a bridge
        - ServiceError: the service's callback raised an exception
        - LocalProtocolError: 1000 calls wait already

        Cancellation leaves nothing behind in the client; the server may still carry out the request.
        """
        core = self._core
        core.check_served()
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

        def deliver(number: int, outcome: Any) -> None:
            if not answer.done():
                answer.set_result(outcome)

        while not (number := core.send(request, deliver)):
            await core.requests.wait_for_room()
        try:
            outcome = await answer
        finally:
            core.forget(number)
        if isinstance(outcome, BusError):
            raise again(outcome)
        return outcome

    def send_request(self, request: Any) -> int:
        """Send `request` and return its number; `on_response` gets the answer with that number.

        Never blocks, and may be called from any thread. Returns 0 if there is no room (when
        `Publisher.publish` returns False): the request was not sent. Does not check that a server exists.
        Without one, the call stays pending until `forget`. Raises the errors of `call`.
        """
        if self._on_response is None:
            raise LocalProtocolError("send_request is for clients that were made with on_response")
        return self._core.send(request, self._on_response)

    def forget(self, number: int) -> bool:
        """Stop waiting for an answer; returns whether there was such a call."""
        return self._core.forget(number)

    def service_is_ready(self) -> bool:
        """Whether a server would receive a call now."""
        return self._core.is_ready()

    async def wait_for_service(self) -> None:
        """Wait until a server exists; use `asyncio.timeout`.

        Raises ConnectionClosed if the client is closed meanwhile. Cancellation leaves nothing behind.
        """
        await self._core.requests.wait_for_subscriptions()

    def statistics(self) -> ServiceClientStatistics:
        """Its counters until now; `close` keeps them."""
        return self._core.statistics()

    @done_anyway
    async def close(self) -> None:
        """Leave the graph; calls that wait get ConnectionClosed. Closing twice is allowed."""
        await self._core.close()
