"""Announces this bus to the engine as the graph changes: subscriptions before publishers."""

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import aclosing, suppress

from bus.endpoint.matches import Match
from bus.errors import ConfigurationError
from bus.graph import Graph
from bus.node import Node
from bus.schema import MessageSchema
from bus_bridge.core.exports import Exports, TopicExports, TypedTopic
from bus_bridge.core.local_graph import LocalGraph, Shown
from bus_bridge.engine import Engine, LocalNode
from bus_bridge.errors import NotCarried, in_words

__all__ = ["Announcing"]

_GRACE_S = 3.0
"""Time after a restart of busd in which endpoints of the old busd may come back."""
_MOST_SCHEMAS = 4096

_Type = tuple[str, str]


class Announcing:
    """Announces nodes and endpoints of this bus. `warn` gets texts for the user."""

    def __init__(
        self, node: Node, engine: Engine, local: LocalGraph, exports: Exports, warn: Callable[[str], None]
    ) -> None:
        self._node = node
        self._engine = engine
        self._local = local
        self._exports = exports
        self._warn = warn
        self._loop = asyncio.get_running_loop()
        self._schemas: dict[_Type, MessageSchema] = {}
        self._withdrawals: dict[bytes, Callable[[], None]] = {}
        self._publishers: dict[bytes, Shown] = {}
        self._in_use: Counter[int] = Counter()
        """Numbers of publishers and subscriptions that the engine shows, by the number of their node."""
        self._gone_nodes: dict[int, LocalNode] = {}
        self._nodes: set[int] = set()
        self._grace_end_s = 0.0
        self._newest: Graph | None = None
        self._has_news = asyncio.Event()
        exports.on_short = self._show_short

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of nodes, publishers and subscriptions that are shown."""
        return len(self._nodes), len(self._publishers), len(self._withdrawals)

    def look_again(self) -> None:
        """Announce the changes: the rules are others now."""
        self._has_news.set()

    async def watch(self) -> None:
        """Follow the graph until cancelled. Raises the error if busd refuses the request."""
        watching = self._loop.create_task(self._watch(), name="watch the graph")
        try:
            while True:
                waiting = self._loop.create_task(self._has_news.wait())
                rest_s = self._grace_end_s - self._loop.time() if self._grace_end_s else None
                try:
                    await asyncio.wait(
                        (watching, waiting), timeout=rest_s, return_when=asyncio.FIRST_COMPLETED
                    )
                finally:
                    waiting.cancel()
                if watching.done():
                    watching.result()
                    return
                self._has_news.clear()
                if self._newest is not None:
                    await self._update(self._newest)
        finally:
            watching.cancel()

    async def _watch(self) -> None:
        async with aclosing(self._node.watch_graph()) as graphs:
            async for graph in graphs:
                self._newest = graph
                self._has_news.set()

    async def _update(self, graph: Graph) -> None:
        now_s = self._loop.time()
        if self._local.is_other_busd(graph):
            self._grace_end_s = now_s + _GRACE_S
        keeps = now_s < self._grace_end_s
        if not keeps:
            self._grace_end_s = 0.0
        changes = self._local.update(graph, keeps=keeps)
        for text in changes.warnings:
            self._warn(text)
        for shown in changes.gone:
            self._withdraw(shown)
        for node in changes.gone_nodes:
            self._gone_nodes[node.id] = node
            self._release_node(node.id)
        for node in changes.nodes:
            self._nodes.add(node.id)
            self._engine.announce_node(node)
        for shown in changes.publishers:
            # The schema is known already. A query could fail: the publisher may leave before busd answers.
            if (known := self._exports.schema(TypedTopic(shown.topic, *_type_of(shown)))) is not None:
                self._schemas[_type_of(shown)] = known
        await self._learn({_type_of(one) for one in (*changes.subscriptions, *changes.publishers)})
        for shown in (*changes.subscriptions, *changes.publishers):
            self._show(shown)

    async def _learn(self, types: set[_Type]) -> None:
        """Fetch the schemas of these types; a type that has left already has none.

        If busd is silent, ask until it answers. Otherwise the unknown types would never cross, because
        nothing is shown twice.
        """
        if len(self._schemas) > _MOST_SCHEMAS:
            self._schemas.clear()

        async def find(one: _Type) -> None:
            while True:
                with suppress(TimeoutError):
                    try:
                        self._schemas[one] = await self._node.get_schema(*one)
                    except ConfigurationError:
                        pass
                    return

        missing = types - self._schemas.keys()
        if missing:
            await asyncio.gather(*map(find, missing))

    def _show(self, shown: Shown) -> None:
        local = shown.local
        schema = self._schemas.get(_type_of(shown))
        if schema is None:
            self._local.give_up(local.gid)
            return
        try:
            if local.kind == "subscription":
                self._withdrawals[local.gid] = self._engine.announce_subscription(local, schema)
            else:
                self._show_publisher(shown, schema)
        except NotCarried:
            self._local.give_up(local.gid)
        except Exception as error:  # an error in one endpoint must not end the bridge
            self._local.give_up(local.gid)
            self._warn(f"'{shown.topic}' does not cross: {in_words(error)}")
        else:
            self._in_use[local.node.id] += 1

    def _show_publisher(self, shown: Shown, schema: MessageSchema) -> None:
        local = shown.local
        export, rule = self._exports.prepare(TypedTopic(shown.topic, *_type_of(shown)), schema, shown)
        try:
            writer = self._engine.announce_publisher(local, schema, rule, export.flush)
        except BaseException:
            self._exports.discard(local.gid)
            raise
        self._publishers[local.gid] = shown
        self._exports.attach(export, writer, local.qos, rule)

    def _show_short(self, route: TopicExports, match: Match) -> None:
        """Show a publisher that has sent messages, but has left before a graph showed it."""
        changes = self._local.add_short(match, route.topic)
        for shown in changes.publishers:
            node = shown.local.node
            self._nodes.add(node.id)
            self._engine.announce_node(node)
            self._schemas[_type_of(shown)] = route.schema
            self._show(shown)
            self._gone_nodes[node.id] = node
            self._withdraw(shown)
            self._release_node(node.id)

    def _withdraw(self, shown: Shown) -> None:
        local = shown.local
        if local.kind == "subscription":
            withdraw = self._withdrawals.pop(local.gid, None)
            if withdraw is not None:
                withdraw()
                self._release(local.node.id)
        elif self._publishers.pop(local.gid, None) is not None:
            # A publisher that still exists was excluded by other rules, and would never come to an end.
            is_excluded = self._local.hides(local.gid)
            self._exports.withdraw(local.gid, lambda: self._release(local.node.id), is_excluded=is_excluded)

    def _release(self, node: int) -> None:
        self._in_use[node] -= 1
        self._release_node(node)

    def _release_node(self, number: int) -> None:
        """Remove a node after its endpoints. Some of them may still have waiting messages."""
        if number in self._gone_nodes and self._in_use[number] <= 0:
            del self._in_use[number]
            self._nodes.discard(number)
            self._engine.withdraw_node(self._gone_nodes.pop(number))


def _type_of(shown: Shown) -> _Type:
    return shown.local.type_name, shown.local.type_hash
