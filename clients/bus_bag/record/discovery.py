"""Finds the topics for a recording, and subscribes to them.

Owns the topics of a recording. A topic is in it from the request for its subscription on. A topic keeps its
first type. Publishers of another type are logged once, and not recorded.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import aclosing, suppress
from functools import partial
from typing import TypeVar

from bus.errors import BusError, ConfigurationError
from bus.events import SubscriptionEvents
from bus.graph import Graph
from bus.node import Node
from bus.qos import Durability, History
from bus.schema import MessageSchema
from bus_bag.record.choice import Choice, Found
from bus_bag.record.options import RecordOptions
from bus_bag.record.pipeline import Pipeline
from bus_bag.record.topic import RecordedTopic, profile_for

__all__ = ["Discovery"]

T = TypeVar("T")


class Discovery:
    """Finds the topics of one recording with `node`, and adds them to `pipeline`.

    `on_arrival(topic)` is called if messages of a topic may have arrived. `on_graph()` is called after all
    new topics of a graph are subscribed.
    """

    def __init__(
        self,
        node: Node,
        options: RecordOptions,
        choice: Choice,
        pipeline: Pipeline,
        *,
        on_arrival: Callable[[RecordedTopic], object],
        on_graph: Callable[[], object],
    ) -> None:
        self._node = node
        self._log = node.get_logger()
        self._options = options
        self._choice = choice
        self._pipeline = pipeline
        self._on_arrival = on_arrival
        self._on_graph = on_graph
        self._refused: set[Found] = set()
        self.topics: dict[str, RecordedTopic] = {}
        """Recorded topics by name."""

    async def run(self) -> None:
        """Follow the graph until cancelled. Without discovery, only examine its first state."""
        try:
            async with aclosing(self._node.watch_graph()) as graphs:
                async for graph in graphs:
                    await self._examine(graph)
                    self._on_graph()
                    if not self._options.has_discovery:
                        return
        except BusError as error:
            self._log.error(f"the search for topics has ended: {error}")

    async def _examine(self, graph: Graph) -> None:
        found, reasons = self._choice.choose(graph)
        for reason in reasons:
            self._log.warning(reason)
        new = [one for one in found if one.topic not in self.topics and one not in self._refused]
        for one in found:
            self._refuse_other_type(one)
        if not new:
            return
        kinds = {(one.type_name, one.type_hash) for one in new}
        schemas = dict(
            zip(kinds, await asyncio.gather(*(self._schema(*kind) for kind in kinds)), strict=True)
        )
        await asyncio.gather(
            *(
                self._subscribe(one, schema)
                for one in new
                if (schema := schemas[one.type_name, one.type_hash]) is not None
            )
        )
        if self._choice.is_complete(self.topics):
            self._log.info("All requested topics are subscribed. Stopping discovery...", once=True)

    def _refuse_other_type(self, found: Found) -> None:
        """Log a topic that is recorded as another type."""
        known = self.topics.get(found.topic)
        if known is None or known.found == found or found in self._refused:
            return
        self._refused.add(found)
        self._log.warning(
            f"Topic '{found.topic}' is recorded as {known.found.type_name}; messages of another type "
            "on it are not recorded"
        )

    async def _schema(self, type_name: str, type_hash: str) -> MessageSchema | None:
        """The schema of a type; None if the topic has gone meanwhile."""
        with suppress(ConfigurationError):
            return await _repeat(lambda: self._node.get_schema(type_name, type_hash))
        return None

    async def _subscribe(self, found: Found, schema: MessageSchema) -> None:
        try:
            topic = RecordedTopic(found, schema)
            profile = self._options.overrides.get(found.topic)
            if profile is not None:
                self._log.info(f"Overriding subscription profile for {found.topic}")
            self.topics[found.topic] = topic
            self._pipeline.add(topic)
            events = SubscriptionEvents(matched=lambda change: self._update_publishers(topic))
            subscription = await _repeat(
                lambda: self._node.create_subscription(
                    schema, found.topic, profile or profile_for(schema), events=events, raw=True
                )
            )
        except BusError as error:
            self.topics.pop(found.topic, None)
            self._refused.add(found)
            self._log.error(f"Topic '{found.topic}' is not recorded: {error}")
            return
        topic.subscribed(subscription)
        subscription.set_arrival_callback(partial(self._on_arrival, topic))
        self._update_publishers(topic)
        self._on_arrival(topic)
        self._log.info(f"Subscribed to topic '{found.topic}'")
        if topic.why_json:
            self._log.warning(f"Topic '{found.topic}' is recorded as JSON text: {topic.why_json}")
        elif topic.encoder.as_json:
            fields = ", ".join(topic.encoder.as_json)
            self._log.warning(f"Topic '{found.topic}': ROS 2 can't describe {fields}; recorded as JSON text")

    def _update_publishers(self, topic: RecordedTopic) -> None:
        """Update the publishers of a topic after a change."""
        if topic.subscription is None:
            return
        matches = topic.subscription.matches
        topic.update_offers(match.qos for match in matches)
        depths = {
            match.gid: match.qos.depth if match.qos.history is History.KEEP_LAST else 0
            for match in matches
            if match.qos.durability is Durability.TRANSIENT_LOCAL
        }
        self._pipeline.set_publishers(topic, depths)


async def _repeat(ask: Callable[[], Awaitable[T]]) -> T:
    """The answer of busd. If busd is silent for long, ask again: the recording continues meanwhile."""
    while True:
        with suppress(TimeoutError):
            return await ask()
