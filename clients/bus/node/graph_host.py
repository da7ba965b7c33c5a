"""The methods of a node for the graph, and for types in it."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing
from typing import TYPE_CHECKING

import msgspec

from bus.endpoint.core import NodeContext
from bus.errors import ConnectionClosed
from bus.wire import messages as m

if TYPE_CHECKING:  # not every program needs them
    from bus.graph import Graph
    from bus.link.graph_watch import GraphWatches
    from bus.link.link import Link
    from bus.schema import MessageSchema

__all__ = ["GraphHost"]


class GraphHost:
    """Base class of Node."""

    _link: Link | None = None
    """None before `open` and after `close`."""
    _watches: GraphWatches | None = None
    """None before the first watch of the graph."""

    @property
    def is_connected(self) -> bool:
        """Whether its connection to busd is open. False before `open`, while it reconnects, after `close`."""
        link = self._link
        return link is not None and link.is_connected

    async def graph(self, *, statistics: bool = False) -> Graph:
        """All nodes, endpoints and matches now; with the endpoints' live counters if asked.

        If busd is away, waits until it is back. Raises ConnectionClosed if the node is not open.

            graph = await node.graph()
        """
        from bus.graph import graph_of

        snapshot = await self._opened().link.request(
            lambda number: m.GetGraph(request=number, statistics=statistics), m.GraphSnapshot
        )
        return graph_of(snapshot)

    async def wait_for_graph(self, condition: Callable[[Graph], bool]) -> Graph:
        """Wait until `condition(graph)` is true; returns that graph.

        `condition` is called again at every change, and once for changes in quick succession, so a large
        graph with many changes costs little. Has no time limit: use `asyncio.timeout`. Cancellation leaves
        nothing behind.

            await node.wait_for_graph(lambda graph: "/chatter" in graph.topics())
        """
        async with aclosing(self._graphs()) as graphs:
            async for graph in graphs:
                if condition(graph):
                    return graph
        raise ConnectionClosed(f"node {self.full_name} is closed")

    def watch_graph(self) -> AsyncGenerator[Graph, None]:
        """The graph now, and again after every change, until the node is closed.

        busd sends only the changes, so a large graph costs little, too. Several changes while the loop's body
        works come as one: the next graph is the newest. It continues after a restart of busd, and waits while
        busd is silent. Raises ConnectionClosed if the node is not open. Cancellation, or leaving the loop,
        leaves nothing behind.

            async for graph in node.watch_graph():
                if "/chatter" in graph.topics():
                    break
        """
        return self._graphs()

    async def get_type(self, type_name: str, type_hash: str) -> type[msgspec.Struct]:
        """A class for a type that is on the bus, made from the description sent with the type.

        `type_name` and `type_hash` are fields of a `GraphEndpoint`. Raises ConfigurationError if no endpoint
        has that type.

            publisher = (await node.graph()).publishers_of("/chatter")[0]
            cls = await node.get_type(publisher.type_name, publisher.type_hash)
        """
        from bus.types.schema import build

        return build((await self.get_schema(type_name, type_hash)).description)

    async def get_schema(self, type_name: str, type_hash: str) -> MessageSchema:
        """The description of a type that is on the bus; for programs that don't need a class of it.

        `type_name` and `type_hash` are fields of a `GraphEndpoint`. Raises ConfigurationError if no endpoint
        has that type.

            publisher = (await node.graph()).publishers_of("/chatter")[0]
            schema = await node.get_schema(publisher.type_name, publisher.type_hash)
        """
        from bus.schema import MessageSchema

        encoded = await self._opened().link.description(type_name, type_hash)
        return MessageSchema(type_name, type_hash, encoded)

    async def _find_schema(self, topic: str, type_name: str | None) -> MessageSchema:
        from bus.schema import find_schema

        async with aclosing(self._graphs()) as graphs:
            found = await find_schema(graphs, topic, type_name, self.get_schema)
        if found is None:
            raise ConnectionClosed(f"node {self.full_name} is closed")
        return found

    def _graphs(self) -> AsyncGenerator[Graph, None]:
        from bus.link.graph_watch import GraphWatches

        link = self._opened().link
        if self._watches is None:
            self._watches = GraphWatches()
        return self._watches.graphs(link)

    @property
    def full_name(self) -> str:
        """The node's full name."""
        raise NotImplementedError

    def _opened(self) -> NodeContext:
        """The open node. Raises ConnectionClosed if the node is not open."""
        raise NotImplementedError
