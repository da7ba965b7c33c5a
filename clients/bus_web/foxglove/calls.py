"""Services of nodes: advertised to a client, and called by it."""

import asyncio
from typing import Any

from bus.errors import BusError
from bus.graph import Graph
from bus.names import is_hidden_topic, reply_topic
from bus.service.client import ServiceClient
from bus_web.foxglove import protocol
from bus_web.foxglove.advertised import Advertised
from bus_web.foxglove.client import Client
from bus_web.foxglove.formats import Formats, ServiceFormat
from bus_web.foxglove.protocol import Call
from bus_web.hub import Hub
from bus_web.shared_subscriptions import TypeKind

__all__ = ["Calls"]

_SETTERS = ("rcl_interfaces/srv/SetParameters", "rcl_interfaces/srv/SetParametersAtomically")
"""They set parameters, and --allow-call is not --allow-set."""
_APPEAR_S = 5.0

_Kinds = tuple[TypeKind, TypeKind]
"""The types of requests and of replies."""


class Calls:
    """The services that one client knows; `close` it in the end."""

    def __init__(self, hub: Hub, formats: Formats, client: Client, *, may_set: bool) -> None:
        self._hub = hub
        self._formats = formats
        self._client = client
        self._may_set = may_set
        self._advertised: Advertised[_Kinds, ServiceFormat] = Advertised()
        self._clients: dict[str, ServiceClient] = {}
        self._making = asyncio.Lock()

    async def advertise(self, graph: Graph) -> None:
        """Send the client the changes of services."""
        kinds = self._kinds(graph)
        if gone := self._advertised.gone(kinds):
            ids = [self._advertised.remove(name) for name in gone]
            self._client.notify(protocol.text("unadvertiseServices", serviceIds=ids))
            for client in [self._clients.pop(name) for name in gone if name in self._clients]:
                await client.close()
        told: list[dict[str, Any]] = []
        for name in self._advertised.missing(kinds):
            format_ = await self._formats.find_service(*kinds[name])
            if format_ is not None:
                told.append(format_.describe(self._advertised.add(name, kinds[name], format_), name))
        if told:
            self._client.notify(protocol.text("advertiseServices", services=told))

    async def call(self, said: Call) -> None:
        """Tell the client the answer, or why there is none."""
        try:
            frame = await self._ask(said)
        except TimeoutError:
            frame = protocol.call_failure(said, "no server exists now")
        except BusError as error:
            frame = protocol.call_failure(said, str(error))
        too_slow = "the answer was dropped, because this client reads too slowly"
        self._client.answer(frame, protocol.call_failure(said, too_slow))

    async def close(self) -> None:
        """End all clients of services."""
        clients, self._clients = self._clients, {}
        for client in clients.values():
            await client.close()

    async def _ask(self, said: Call) -> bytes:
        name = self._advertised.name_of(said.service_id)
        if name is None:
            return protocol.call_failure(said, f"there is no service {said.service_id}")
        if said.encoding != "cdr":
            return protocol.call_failure(said, f"requests must be in cdr, not in {said.encoding!r:.40}")
        format_ = self._advertised.entries[name].format
        request = format_.read_request(said.data)
        async with self._making:
            client = self._clients.get(name)
            if client is None:
                client = self._clients[name] = await self._hub.node.create_client(format_.definition, name)
        async with asyncio.timeout(_APPEAR_S):
            await client.wait_for_service()
        return protocol.response(said, "cdr", format_.write_response(await client.call(request)))

    def _kinds(self, graph: Graph) -> dict[str, _Kinds]:
        """The types of requests and replies of each service that has a server."""
        found: dict[str, _Kinds] = {}
        for name in graph.services():
            servers, replies = graph.servers_of(name), graph.publishers_of(reply_topic(name))
            if not servers or not replies or is_hidden_topic(name):
                continue
            if not self._may_set and servers[0].type_name.removesuffix("_Request") in _SETTERS:
                continue
            found[name] = (
                (servers[0].type_name, servers[0].type_hash),
                (replies[0].type_name, replies[0].type_hash),
            )
        return found
