"""The graph: every node, endpoint, topic, match and type, with snapshots and deltas for observers.

Owns the tables and the revision. Knows no rule of matching and sends nothing.
"""

from collections import Counter
from itertools import count

from bus.ids import EndpointId, NodeId
from bus.wire.messages import EndpointRecord, GraphChanged, MatchRecord, NodeRecord
from bus.wire.messages import Graph as Snapshot
from busd.core.entities import MessageType, Node, Peer, Publisher, Sharing, Subscription, Topic


class Graph:
    """The tables. All changes go through its methods, so that none escapes the observers."""

    def __init__(self) -> None:
        self.nodes: dict[NodeId, Node] = {}
        self.publishers: dict[EndpointId, Publisher] = {}
        self.subscriptions: dict[EndpointId, Subscription] = {}
        self.topics: dict[str, Topic] = {}
        self.types: dict[MessageType, bytes] = {}
        self.revision = 0
        self._names: Counter[str] = Counter()
        self._ids = count(1)
        self._nodes_added: list[NodeRecord] = []
        self._nodes_removed: list[int] = []
        self._endpoints_added: list[EndpointRecord] = []
        self._endpoints_removed: list[int] = []
        self._matches_added: list[MatchRecord] = []
        self._matches_removed: list[MatchRecord] = []

    def next_id(self) -> int:
        """A number that no node or endpoint ever had."""
        return next(self._ids)

    def add_node(self, node: Node) -> None:
        self.nodes[node.id] = node
        self._names[node.full_name] += 1
        node.peer.nodes[node.id] = node
        self._nodes_added.append(node.record())

    def remove_node(self, node: Node) -> None:
        """The node's endpoints must have been removed."""
        del self.nodes[node.id], node.peer.nodes[node.id]
        self._names[node.full_name] -= 1
        if not self._names[node.full_name]:
            del self._names[node.full_name]
        self._nodes_removed.append(node.id)

    def has_node_named(self, full_name: str) -> bool:
        return full_name in self._names

    def topic(self, name: str) -> Topic:
        """The topic of that name; a new one is not in the table until it has an endpoint."""
        return self.topics.get(name) or Topic(name)

    def add_endpoint(self, endpoint: Publisher | Subscription) -> None:
        topic = self.topics.setdefault(endpoint.topic.name, endpoint.topic)
        if isinstance(endpoint, Publisher):
            topic.publishers[endpoint.id] = self.publishers[endpoint.id] = endpoint
        else:
            topic.subscriptions[endpoint.id] = self.subscriptions[endpoint.id] = endpoint
        endpoint.node.endpoints[endpoint.id] = endpoint.node.peer.endpoints[endpoint.id] = endpoint
        self._endpoints_added.append(endpoint.record())

    def remove_endpoint(self, endpoint: Publisher | Subscription) -> None:
        """The endpoint's matches must have been removed."""
        topic = endpoint.topic
        if isinstance(endpoint, Publisher):
            del topic.publishers[endpoint.id], self.publishers[endpoint.id]
        else:
            del topic.subscriptions[endpoint.id], self.subscriptions[endpoint.id]
        if not topic.publishers and not topic.subscriptions:
            del self.topics[topic.name]
        del endpoint.node.endpoints[endpoint.id], endpoint.node.peer.endpoints[endpoint.id]
        self._endpoints_removed.append(endpoint.id)

    def add_match(
        self, publisher: Publisher, subscription: Subscription, sharing: Sharing | None = None
    ) -> None:
        """A match on the route shm with `sharing`, else on the route socket."""
        publisher.matches[subscription.id] = subscription
        subscription.matches[publisher.id] = publisher
        if sharing is None:
            publisher.routed[subscription.id] = subscription
        else:
            publisher.shared[subscription.id] = sharing
        for peer in {publisher.node.peer, subscription.node.peer}:
            peer.matches += 1
        self._matches_added.append(_match_record(publisher, subscription.id))

    def reroute(self, publisher: Publisher, subscription: Subscription) -> None:
        """From the route shm to the route socket, by which it gets nothing yet."""
        self._matches_removed.append(_match_record(publisher, subscription.id))
        del publisher.shared[subscription.id]
        self._matches_added.append(_match_record(publisher, subscription.id))

    def remove_match(self, publisher: Publisher, subscription: Subscription) -> None:
        self._matches_removed.append(_match_record(publisher, subscription.id))
        publisher.routed.pop(subscription.id, None)
        publisher.shared.pop(subscription.id, None)
        del publisher.matches[subscription.id], subscription.matches[publisher.id]
        for peer in {publisher.node.peer, subscription.node.peer}:
            peer.matches -= 1

    def forget_types(self, peer: Peer, others: list[Peer]) -> None:
        """Forget the schemas that only `peer` had declared."""
        for kind in peer.types:
            if not any(kind in other.types for other in others):
                self.types.pop(kind, None)

    def take_change(self) -> GraphChanged | None:
        """What changed since the last call, as the next revision."""
        if not (
            self._nodes_added
            or self._nodes_removed
            or self._endpoints_added
            or self._endpoints_removed
            or self._matches_added
            or self._matches_removed
        ):
            return None
        self.revision += 1
        change = GraphChanged(
            revision=self.revision,
            nodes_added=tuple(self._nodes_added),
            nodes_removed=tuple(self._nodes_removed),
            endpoints_added=tuple(self._endpoints_added),
            endpoints_removed=tuple(self._endpoints_removed),
            matches_added=tuple(self._matches_added),
            matches_removed=tuple(self._matches_removed),
        )
        for pending in (
            self._nodes_added,
            self._nodes_removed,
            self._endpoints_added,
            self._endpoints_removed,
            self._matches_added,
            self._matches_removed,
        ):
            pending.clear()
        return change

    def snapshot(self, request: int, *, statistics: bool, pid: int) -> Snapshot:
        """Everything, as the answer to `request`."""
        endpoints = [*self.publishers.values(), *self.subscriptions.values()]
        return Snapshot(
            request=request,
            revision=self.revision,
            nodes=tuple(node.record() for node in self.nodes.values()),
            endpoints=tuple(endpoint.record(statistics=statistics) for endpoint in endpoints),
            matches=tuple(
                _match_record(publisher, subscription)
                for publisher in self.publishers.values()
                for subscription in publisher.matches
            ),
            pid=pid,
        )


def _match_record(publisher: Publisher, subscription: EndpointId) -> MatchRecord:
    return MatchRecord(publisher=publisher.id, subscription=subscription, route=publisher.route(subscription))
