"""Of the graph, what a client is told of it: channels, services, and who is connected with whom. Pure.

A table is a client's: it knows what the client was told, and says what is to be told next. Ids are given
once.
"""

from collections.abc import Iterable, Mapping
from itertools import count
from typing import Any, NamedTuple

from bus.graph import Graph
from bus.names import is_hidden_node, is_hidden_topic

__all__ = ["Channels", "ConnectionGraph", "Described", "Kind", "Table"]

Kind = tuple[str, str]
"""A type's name and hash."""


class Described(NamedTuple):
    """A type as clients read it."""

    name: str
    definition: str


class Table:
    """Things by name, each with the kind that it has, under ids that clients know them by."""

    def __init__(self) -> None:
        self._numbers = count(1)
        self._ids: dict[str, tuple[int, Any]] = {}
        self._names: dict[int, str] = {}

    def __len__(self) -> int:
        return len(self._ids)

    def name_of(self, id: int) -> str | None:
        """None where the client was not told of such an id, or it has gone."""
        return self._names.get(id)

    def kind_of(self, name: str) -> Any:
        """None where the client does not know it."""
        known = self._ids.get(name)
        return known[1] if known is not None else None

    def gone(self, now: Mapping[str, Any]) -> list[int]:
        """Forget what isn't there any more, or is of another kind; returns its ids, which are to be told."""
        gone = [(name, id) for name, (id, kind) in self._ids.items() if now.get(name) != kind]
        for name, id in gone:
            del self._ids[name], self._names[id]
        return [id for _, id in gone]

    def missing(self, now: Mapping[str, Any]) -> list[str]:
        """What the client does not know yet."""
        return [name for name in now if name not in self._ids]

    def add(self, name: str, kind: Any) -> int:
        """Returns the id by which it is told."""
        id = next(self._numbers)
        self._ids[name] = id, kind
        self._names[id] = name
        return id


class Channels(Table):
    """Topics as channels."""

    def tell(self, topic: str, kind: Kind, described: Described) -> dict[str, Any]:
        """The channel of a topic that is `missing`."""
        return {
            "id": self.add(topic, kind),
            "topic": topic,
            "encoding": "cdr",
            "schemaName": described.name,
            "schema": described.definition,
            "schemaEncoding": "ros2msg",
        }


class ConnectionGraph:
    """Who publishes, subscribes and serves; hidden topics and the tools' own nodes are left out."""

    def __init__(self) -> None:
        self._told: tuple[dict[str, list[str]], ...] = ({}, {}, {})

    def update(self, graph: Graph) -> dict[str, Any] | None:
        """The fields of what is to be told; None where nothing is new."""
        published = _nodes_by_topic(graph.publishers)
        subscribed = _nodes_by_topic(graph.subscriptions)
        served = {
            service: sorted({one.node.full_name for one in graph.servers_of(service)})
            for service in graph.services()
            if not is_hidden_topic(service)
        }
        served = {service: nodes for service, nodes in served.items() if nodes}
        before, self._told = self._told, (published, subscribed, served)
        if before == self._told:
            return None
        topics_before, topics = before[0].keys() | before[1].keys(), published.keys() | subscribed.keys()
        emptied: list[dict[str, list[str]]] = [
            {name: [] for name in old.keys() - new.keys() if name in topics}
            for old, new in zip(before[:2], self._told[:2], strict=True)
        ]
        return {
            "publishedTopics": _changed(before[0], published | emptied[0], "publisherIds"),
            "subscribedTopics": _changed(before[1], subscribed | emptied[1], "subscriberIds"),
            "advertisedServices": _changed(before[2], served, "providerIds"),
            "removedTopics": sorted(topics_before - topics),
            "removedServices": sorted(before[2].keys() - served.keys()),
        }


def _nodes_by_topic(endpoints: Iterable[Any]) -> dict[str, list[str]]:
    found: dict[str, set[str]] = {}
    for one in endpoints:
        if not is_hidden_topic(one.topic) and not is_hidden_node(one.node.name):
            found.setdefault(one.topic, set()).add(one.node.full_name)
    return {topic: sorted(nodes) for topic, nodes in found.items()}


def _changed(before: Mapping[str, list[str]], now: Mapping[str, list[str]], ids: str) -> list[dict[str, Any]]:
    return [{"name": name, ids: nodes} for name, nodes in sorted(now.items()) if before.get(name) != nodes]
