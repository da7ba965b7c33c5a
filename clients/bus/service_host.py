"""The part of a node that makes services and clients.

Owns: that the two endpoints of each come and go together. Must not know: what else a node has.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from bus.base.awaited import to_be_awaited
from bus.diagnostics.slow_callback import watched
from bus.endpoint import NodeContext
from bus.errors import ConnectionClosed
from bus.logger import Logger
from bus.publisher import Publisher
from bus.qos import QoS, QoSProfile, profile

if TYPE_CHECKING:  # most programs need neither
    from bus.client import ServiceClient
    from bus.service import RequestId, ServiceServer
    from bus.subscription import Subscription

__all__ = ["SERVICE_QOS", "ServiceHost"]

# ROS 2's depth for services is 10, with which a burst of more calls would lose requests without a word.
SERVICE_QOS: Final = QoSProfile(depth=1000)
"""What both sides of a service have where nothing else is asked for."""


class ServiceHost(ABC):
    """Base of Node."""

    _logger: Logger

    @property
    @abstractmethod
    def full_name(self) -> str: ...

    @abstractmethod
    def resolve_topic_name(self, topic: str) -> str: ...

    @abstractmethod
    def _opened(self) -> NodeContext: ...

    @abstractmethod
    async def _declare(self, endpoint: "Publisher[Any] | Subscription[Any]") -> None: ...

    @to_be_awaited
    async def create_service(
        self,
        service_type: type[Any],
        name: str,
        callback: Callable[..., Any] | None = None,
        qos: QoS = SERVICE_QOS,
        *,
        on_request: Callable[[Any, "RequestId"], Any] | None = None,
    ) -> "ServiceServer":
        """Serve `service_type`, a class as `bus.Service` says, as `name`.

        `callback` is `def` or `async def`, of (request), and returns the response; or of (request, response),
        of which the second is there to be filled and returned. Calls of an async one run side by side, up to
        a hundred. An exception goes to the client as ServiceError, and out of the node as any callback's.
        For `on_request`, in place of a callback, see `ServiceServer`. By default `qos` is keep last 1000.

        Raises as `create_publisher`, TypeError for both or neither of a callback and `on_request`.
        Cancellation: not created.

            server = await node.create_service(
                AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=request.a + request.b)
            )
        """
        from bus.service import ServiceServer

        node, full_name = self._opened(), self.resolve_service_name(name)
        if callback is not None:
            callback = watched(callback, f"service '{full_name}'", self._logger)
        server = ServiceServer(
            node,
            full_name,
            service_type,
            profile(qos),
            callback=callback,
            on_request=on_request,
        )
        await self._declare_both(*server._endpoints)
        return server

    @to_be_awaited
    async def create_client(
        self,
        service_type: type[Any],
        name: str,
        qos: QoS = SERVICE_QOS,
        *,
        on_response: Callable[[int, Any], object] | None = None,
    ) -> "ServiceClient":
        """A client of the service `name`; whoever serves it already is known on return.

        By default `qos` is keep last 1000. For `on_response` see `ServiceClient`. Raises as
        `create_publisher`. Cancellation: not created.

            client = await node.create_client(AddTwoInts, "add")
        """
        from bus.client import ServiceClient

        client = ServiceClient(
            self._opened(),
            self.resolve_service_name(name),
            service_type,
            profile(qos),
            on_response=on_response,
        )
        await self._declare_both(*client._endpoints)
        return client

    def resolve_service_name(self, name: str) -> str:
        """The full name of a service as this node means it; the rules for topics are for services, too.

        Raises ConfigurationError for a bad name.
        """
        return self.resolve_topic_name(name)

    async def _declare_both(
        self, first: "Publisher[Any] | Subscription[Any]", second: "Publisher[Any] | Subscription[Any]"
    ) -> None:
        """The two endpoints of a service or client: both, or none."""
        try:
            await self._declare(first)
            await self._declare(second)
        except BaseException as error:
            for endpoint in (first, second):
                if endpoint._refusal is None:
                    endpoint._link.forget(endpoint)
                    endpoint._end(ConnectionClosed(f"not created: {error}"))
            raise
