"""The interface of a node that its parameters need."""

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Protocol

from bus.endpoint.core import NodeContext
from bus.logger import Logger
from bus.publisher import Publisher
from bus.qos import QoS

if TYPE_CHECKING:  # few programs need them
    from bus.service.server import ServiceServer
    from bus.subscription import Subscription

__all__ = ["ParameterOwner"]


class ParameterOwner(Protocol):
    """A node: its name, its log, and its methods to make endpoints for parameters."""

    @property
    def full_name(self) -> str: ...

    def get_logger(self) -> Logger: ...

    def create_service(
        self, service_type: type[Any], name: str, callback: Callable[..., Any]
    ) -> "Awaitable[ServiceServer]": ...

    def create_subscription(
        self, message_type: type[Any], topic: str, qos: QoS, callback: Callable[[Any], object]
    ) -> "Awaitable[Subscription[Any]]": ...

    async def _create_publisher(
        self, message_type: type[Any], topic: str, qos: QoS, *, by_socket: bool = False
    ) -> Publisher[Any]: ...

    def _opened(self) -> NodeContext:
        """The open node. Raises ConnectionClosed if the node is not open."""
