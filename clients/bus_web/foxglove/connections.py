"""Publishers, subscribers and servers in the form for a client: first all, then the changes. Pure."""

from collections.abc import Iterable, Mapping
from typing import Any

from bus.graph import Graph
from bus.names import is_hidden_node, is_hidden_topic

__all__ = ["ConnectionGraph"]


class ConnectionGraph:
    """The part of the graph that one client knows. Hidden topics and the tools' own nodes are left out."""

    def __init__(self) -> None:
        self._told: tuple[dict[str, list[str]], ...] = ({}, {}, {})

    def update(self, graph: Graph) -> dict[str, Any] | None:
        """The fields of the update to send; None if nothing is new."""
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
