"""Requests of recorded calls: sent to their service, in place of the service's events."""

import asyncio
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

from msgspec import Struct

from bus.errors import ConfigurationError
from bus.graph import Graph
from bus.logger import Logger
from bus.node import Node
from bus.schema import MessageSchema
from bus.service.client import ServiceClient
from bus.srv import make_service
from bus.types.support import type_support
from bus_bag.topic_names import SERVICE_EVENT

__all__ = ["SOURCES", "ServiceRequests"]

SOURCES = {"service_introspection": 1, "client_introspection": 0}
"""For each source of requests, the type of the events with them: REQUEST_RECEIVED, REQUEST_SENT."""

_READY_S = 2.0
_ROOM_S = 0.01


class ServiceRequests:
    """Takes a service's events as a publisher does, and sends the requests in them."""

    def __init__(
        self,
        client: ServiceClient,
        answered: asyncio.Event,
        event_type: type[Struct],
        source: str,
        logger: Logger,
    ) -> None:
        self._client = client
        self._answered = answered
        """Set at each answer. In a replay, answers have no other receiver."""
        self._event = type_support(event_type)
        self._kind = SOURCES[source]
        self._logger = logger
        self._has_warned = False

    @classmethod
    async def open(
        cls, node: Node, graph: Graph, topic: str, schema: MessageSchema, source: str
    ) -> "ServiceRequests":
        """Make the client of the service to which an event topic belongs.

        Raises ConfigurationError if `schema` does not describe a service's events, or any error of
        `Node.create_client`.
        """
        event_type = schema.to_class()
        hints = get_type_hints(event_type, include_extras=True)
        parts = [next(_classes_in(hints.get(name)), None) for name in ("request", "response")]
        if "info" not in hints or None in parts:
            raise ConfigurationError(f"{schema.type_name} is not a type of service events")
        service: Any = make_service(schema.type_name.removesuffix("_Event"), *map(_certain, parts))
        name = topic.removesuffix(SERVICE_EVENT)
        answered = asyncio.Event()
        client = await node.create_client(service, name, on_response=lambda *_: answered.set())
        if graph.servers_of(client.service_name):  # a new client takes a moment to see its server
            try:
                async with asyncio.timeout(_READY_S):
                    await client.wait_for_service()
            except TimeoutError:
                pass
        return cls(client, answered, event_type, source, node.get_logger())

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool:
        """Send the request of an event, if it has the chosen type. Returns False if there is no room."""
        event: Any = self._event.decode(payload)
        if event.info.event_type != self._kind:
            return True
        name = self._client.service_name
        if not self._client.service_is_ready():
            self._logger.error(f"Service request hasn't been sent. The '{name}' service isn't ready !")
            return True
        if not event.request:
            self._warn_once(name)
            return True
        return self._client.send_request(event.request[0]) != 0

    async def wait_for_room(self) -> None:
        await asyncio.sleep(_ROOM_S)

    async def flush(self) -> None:
        """Wait until the service has answered all requests."""
        while self._client.statistics().pending:
            self._answered.clear()
            await self._answered.wait()

    def _warn_once(self, name: str) -> None:
        if not self._has_warned:
            side = "service" if self._kind == SOURCES["service_introspection"] else "client"
            self._logger.warning(
                f"Can't send service request. The configuration of introspection for '{name}' was metadata "
                f"only on {side} side!"
            )
        self._has_warned = True


def _certain(part: type[Struct] | None) -> type[Struct]:
    assert part is not None
    return part


def _classes_in(hint: Any) -> Iterator[type[Struct]]:
    """The message classes in an annotation such as `Annotated[list[Request], ...]`."""
    if isinstance(hint, type) and issubclass(hint, Struct):
        yield hint
    for part in get_args(hint):
        yield from _classes_in(part)
