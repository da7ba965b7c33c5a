"""The interface between services of this bus and a carrier of ROS 2's calls. Values and protocols only."""

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

from bus.qos import QoSProfile
from bus_bridge.engine import LocalNode
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.service_types import ServiceTypes

__all__ = ["OF_SERVICES", "CallCarrier", "Client", "NoServer", "RequestId", "Response", "Server", "Services"]

OF_SERVICES: Final = QoSProfile(1000)
"""The profile of a far server or client: the number of its calls that may wait."""


class NoServer(BridgeError):
    """A call that gets no answer: its server has gone."""


class RequestId(NamedTuple):
    """The identity of a request of a far client."""

    client: bytes
    """Fast DDS: the GUID to name in the answer. Cyclone: the header to return. Zenoh: the client's gid."""
    number: int
    """Fast DDS, Zenoh: the number of the request. Cyclone: 0."""
    writer: bytes
    """The gid of the publisher that stands for the client on this bus. In DDS, the request's writer."""

    @property
    def reader(self) -> bytes:
        """In DDS, the GUID of the reader that gets the answer; Cyclone does not name it."""
        return self.client if self.number else b""


class Response(NamedTuple):
    """The answer to a call."""

    cdr: bytes
    writer: bytes
    """The gid of the far publisher that it came from; empty if that is not known."""


class Server(Protocol):
    """A service that we offer."""

    @property
    def guids(self) -> tuple[bytes, bytes]:
        """Its identity in the graph: the gids of its subscription and of its publisher."""

    def answer(self, request: RequestId, cdr: bytes) -> bool:
        """Answer a request; returns False if it has an answer, or if its client has gone."""

    def drop(self, request: RequestId) -> None:
        """There will be no answer: ROS 2 has none that says that a request failed."""

    def close(self) -> None:
        """Withdraw the service. A second call has no effect."""


class Client(Protocol):
    """A client of ours."""

    @property
    def guids(self) -> tuple[bytes, bytes]:
        """As `Server.guids`."""

    async def wait_until_ready(self) -> None:
        """Wait for a server. Raises NoServer if the client is closed. Cancellation leaves nothing behind."""

    async def call(self, cdr: bytes) -> Response:
        """Make a call. There is no time limit.

        Raises NoServer if there is no server, or if it leaves without an answer. Raises BridgeError for too
        many calls at once. Cancellation gives the call up.
        """

    def close(self) -> None:
        """End the client: its calls fail. A second call has no effect."""


class Services(Protocol):
    """Makes servers and clients in ROS 2."""

    @property
    def warn(self) -> Callable[[str], None]:
        """Reports a problem to the user."""

    def serve(
        self,
        service: str,
        type_name: str,
        on_request: Callable[[RequestId, bytes], None],
        user_data: bytes = b"",
    ) -> Server:
        """Offer a service. `on_request` is called with the id and the CDR of each request."""

    def make_client(self, service: str, type_name: str, user_data: bytes = b"") -> Client:
        """Make a client of a service."""


class CallCarrier(Protocol):
    """A carrier of ROS 2's calls."""

    @property
    def warn(self) -> Callable[[str], None]:
        """Reports a problem to the user."""

    def for_end(self, node: LocalNode, types: ServiceTypes) -> Services:
        """The services of a node, for one server or client with these types."""
