"""Types of the bus for clients: described as in ROS 2, with messages in CDR."""

import asyncio
from typing import Any, NamedTuple

from bus.errors import BusError, ConfigurationError
from bus.node import Node
from bus.schema import MessageSchema
from bus.srv import Service, make_service
from bus.types.service import message_of
from bus.types.support import type_support
from bus_ros.cdr import CdrError, Codec, codec_of
from bus_web.shared_subscriptions import TypeKind

__all__ = ["Formats", "ServiceFormat", "describe_channel"]

_ANSWER_S = 2.0
_MOST = 4096


class ServiceFormat(NamedTuple):
    """A type of services."""

    definition: type[Service]
    request: Codec
    response: Codec

    def describe(self, id: int, name: str) -> dict[str, Any]:
        """A service of this type; `requestSchema` and the like are for older clients."""
        return {
            "id": id,
            "name": name,
            "type": self.definition.__type_name__,
            "request": _schema(self.request),
            "response": _schema(self.response),
            "requestSchema": self.request.definition,
            "responseSchema": self.response.definition,
        }

    def read_request(self, data: Any) -> Any:
        """A request of the type, in CDR. Raises CdrError."""
        payload = self.request.decode(data)
        try:
            return type_support(self.definition.Request).decode(payload)
        except ValueError as error:
            raise CdrError(f"not a valid request of {self.definition.__type_name__}: {error}") from None

    def write_response(self, response: Any) -> list[Any]:
        """The parts of an answer in CDR. Raises CdrError."""
        return self.response.encode(type_support(self.definition.Response).encode(response))


class Formats:
    """The codecs of types, asked for once for all clients of `node`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: dict[TypeKind, Codec | str] = {}
        self._services: dict[tuple[TypeKind, TypeKind], ServiceFormat] = {}

    async def find(self, kind: TypeKind) -> Codec | str | None:
        """A text: why the type has no codec. None: the bus gives no answer now; ask again later."""
        known = self._known.get(kind)
        if known is not None:
            return known
        try:
            async with asyncio.timeout(_ANSWER_S):
                schema = await self._node.get_schema(*kind)
        except (BusError, TimeoutError):
            return None
        try:
            known = codec_of(schema)
        except ConfigurationError as error:
            known = str(error)
        if len(self._known) >= _MOST:
            del self._known[next(iter(self._known))]
        self._known[kind] = known
        return known

    async def find_service(self, request: TypeKind, response: TypeKind) -> ServiceFormat | None:
        """None if the bus gives no answer, or ROS 2 can't describe the service."""
        known = self._services.get((request, response))
        if known is not None:
            return known
        try:
            async with asyncio.timeout(_ANSWER_S):
                asked, answered = [
                    message_of(await self._node.get_type(*kind)) for kind in (request, response)
                ]
            definition = make_service(request[0].removesuffix("_Request"), asked, answered)
            known = ServiceFormat(
                definition, codec_of(MessageSchema.of(asked)), codec_of(MessageSchema.of(answered))
            )
        except (BusError, TimeoutError):
            return None
        if len(self._services) >= _MOST:
            del self._services[next(iter(self._services))]
        self._services[request, response] = known
        return known


def describe_channel(id: int, topic: str, codec: Codec) -> dict[str, Any]:
    """A channel, as announced to clients."""
    return {"id": id, "topic": topic, **_schema(codec)}


def _schema(codec: Codec) -> dict[str, str]:
    return {
        "encoding": "cdr",
        "schemaName": codec.type_name,
        "schemaEncoding": "ros2msg",
        "schema": codec.definition,
    }
