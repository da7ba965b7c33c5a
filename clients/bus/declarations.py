"""What a process has declared at its broker: nodes and endpoints, the ids they got, and declaring them anew.

Knows nodes and endpoints only by the methods that `Declared` and `Endpoint` name.
"""

import asyncio
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from bus.connection import Connection
from bus.errors import BusError, ConfigurationError, QuotaExceeded
from bus.logger import get_logger
from bus.qos import QoSProfile
from bus.typesupport import TypeSupport
from bus.wire import messages as m
from bus.wire.runs import Run

_log = get_logger("bus")


class Declared(Protocol):
    """What the broker gives an id to."""

    id: int

    def declaration(self, request: int, node: int) -> m.Message: ...

    def declared(self, answer: m.Created) -> None: ...


class Endpoint(Declared, Protocol):
    """A publisher or a subscription, as the link sees it."""

    kind: str
    topic_name: str
    qos: QoSProfile
    support: TypeSupport[Any]
    refusal: BusError | None

    def disconnected(self) -> None: ...

    def handle(self, message: Any) -> None: ...

    def hand_over(self) -> None: ...

    def receive_run(self, run: Run) -> None: ...

    def wake(self) -> None: ...

    def totals(self) -> m.Report: ...

    def end(self, reason: BusError) -> None: ...


class Declarations:
    """`by_id` are the endpoints that the broker knows at the moment."""

    def __init__(self) -> None:
        self.by_id: dict[int, Endpoint] = {}
        self._nodes: dict[Declared, dict[Endpoint, None]] = {}
        self._admissions: dict[int, Callable[[m.Created], None]] = {}

    def __iter__(self) -> Iterator[Endpoint]:
        """Every endpoint, in the order of their making."""
        return iter([endpoint for endpoints in self._nodes.values() for endpoint in endpoints])

    async def add_node(self, connection: Connection, node: Declared) -> None:
        """Make `node` known to the broker."""

        def admit(answer: m.Created) -> None:
            node.declared(answer)
            self._nodes.setdefault(node, {})

        await self._declare(
            connection,
            lambda number: node.declaration(number, 0),
            admit,
            lambda answer: m.DestroyNode(node=answer.id),
        )

    async def add(self, connection: Connection, node: Declared, endpoint: Endpoint) -> None:
        """Make an endpoint of `node` known to the broker. Raises what the broker refuses it with."""

        def admit(answer: m.Created) -> None:
            endpoint.declared(answer)
            self._nodes[node][endpoint] = None
            self.by_id[answer.id] = endpoint

        connection.declare_type(endpoint.support)
        await self._declare(
            connection,
            lambda number: endpoint.declaration(number, node.id),
            admit,
            lambda answer: m.DestroyEndpoint(endpoint=answer.id),
        )

    async def declare_again(self, connection: Connection) -> None:
        """Tell a new broker everything. An endpoint that it refuses is ended, and the log says why."""
        nodes = tuple(self._nodes)
        await asyncio.gather(*(self.add_node(connection, node) for node in nodes))
        pairs = [(node, endpoint) for node in nodes for endpoint in self._nodes.get(node, ())]
        await asyncio.gather(*(self._try_again(connection, node, endpoint) for node, endpoint in pairs))

    def admit(self, answer: m.Created) -> None:
        """The broker made something. To be called before anything that came after is handled."""
        admission = self._admissions.pop(answer.request, None)
        if admission is not None:
            admission(answer)

    def remove(self, endpoint: Endpoint) -> None:
        for endpoints in self._nodes.values():
            endpoints.pop(endpoint, None)
        self.by_id.pop(endpoint.id, None)

    def remove_node(self, node: Declared) -> bool:
        """Returns whether it was declared."""
        return self._nodes.pop(node, None) is not None

    def disconnected(self) -> None:
        """The broker is gone, and with it all ids."""
        self._admissions.clear()
        self.by_id.clear()
        for endpoint in self:
            endpoint.disconnected()

    def shortest_lease_s(self) -> float | None:
        """The shortest liveliness lease that a publisher has promised."""
        leases = [
            endpoint.qos.liveliness_lease_duration
            for endpoint in self
            if endpoint.kind == "publisher" and endpoint.qos.liveliness_lease_duration is not None
        ]
        return min(leases, default=None)

    async def _try_again(self, connection: Connection, node: Declared, endpoint: Endpoint) -> None:
        try:
            await self.add(connection, node, endpoint)
        except (ConfigurationError, QuotaExceeded) as error:
            _log.error(f"the new busd refuses the {endpoint.kind} on '{endpoint.topic_name}': {error}")
            self.remove(endpoint)
            endpoint.end(error)

    async def _declare(
        self,
        connection: Connection,
        make: Callable[[int], m.Message],
        admit: Callable[[m.Created], None],
        undo: Callable[[m.Created], m.Message],
    ) -> None:
        request = 0

        def declaration(number: int) -> m.Message:
            nonlocal request
            request = number
            self._admissions[number] = admit
            return make(number)

        try:
            await connection.request(declaration)
        except (asyncio.CancelledError, TimeoutError):
            if request in self._admissions:
                # Nobody waits for the answer any more: what it makes is not wanted.
                self._admissions[request] = lambda answer: connection.send(undo(answer))
            raise
        except BaseException:
            self._admissions.pop(request, None)
            raise
