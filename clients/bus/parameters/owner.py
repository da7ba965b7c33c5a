"""The interface of a node that its parameters need."""

from collections.abc import Awaitable, Callable, Coroutine
from typing import TYPE_CHECKING, Any, Protocol

from bus.endpoint.core import NodeContext
from bus.logger import Logger
from bus.publisher import Publisher
from bus.qos import QoS

if TYPE_CHECKING:  # few programs need it
    from bus.subscription import Subscription

__all__ = ["ParameterOwner"]


class Service(Protocol):
    """The server of a service."""

    def close(self) -> Coroutine[Any, Any, None]: ...


class ParameterOwner(Protocol):
    """A node: its name, its log, and its methods to make endpoints for parameters."""

    @property
    def full_name(self) -> str: ...

    def get_logger(self) -> Logger: ...

    def create_service(
        self, service_type: type[Any], name: str, callback: Callable[..., Any]
    ) -> Awaitable[Service]: ...

    def create_subscription(
        self, message_type: type[Any], topic: str, qos: QoS, callback: Callable[[Any], object]
    ) -> "Awaitable[Subscription[Any]]": ...

    async def _create_publisher(
        self, message_type: type[Any], topic: str, qos: QoS, *, by_socket: bool = False
    ) -> Publisher[Any]: ...

    def _opened(self) -> NodeContext:
        """The open node. Raises ConnectionClosed if the node is not open."""
