"""The graph: every node, endpoint, topic and match, with the changes for observers (`busd.core.changes`).

Owns the tables. Knows no rule of matching and sends nothing.
"""

from itertools import count

from bus.base.ids import EndpointId, NodeId
from bus.wire.messages import MatchRecord
from busd.core.changes import Changes
from busd.core.entities import ROUTE_OF, Match, Node, Publisher, Subscription, Topic
from busd.core.match import MatchEvent
from busd.core.type_table import TypeTable


class Graph:
    """The tables. All changes go through its methods, so observers miss none."""

    def __init__(self) -> None:
        self.nodes: dict[NodeId, Node] = {}
        self.publishers: dict[EndpointId, Publisher] = {}
        self.subscriptions: dict[EndpointId, Subscription] = {}
        self.topics: dict[str, Topic] = {}
        self.types = TypeTable()
        self.changes = Changes()
        self._matches = 0
        self._left_samples = self._left_bytes = 0  # of publishers that are gone
        self._names: dict[str, dict[NodeId, Node]] = {}
        self._gids: dict[bytes, Publisher | Subscription] = {}  # as shown
        self.next_id = count(1).__next__
        """Gives a number that no node or endpoint ever had."""

    def __len__(self) -> int:
        """Records in a snapshot (`busd.core.snapshot`)."""
        return len(self.nodes) + len(self.publishers) + len(self.subscriptions) + self._matches

    def add_node(self, node: Node) -> None:
        self.nodes[node.id] = node
        self._names.setdefault(node.full_name, {})[node.id] = node
        node.peer.nodes[node.id] = node
        node.peer.user.nodes += 1
        self.changes.nodes_added.append(node.record())

    def remove_node(self, node: Node) -> None:
        """The node's endpoints must have been removed."""
        del self.nodes[node.id], node.peer.nodes[node.id]
        node.peer.user.nodes -= 1
        del self._names[node.full_name][node.id]
        if not self._names[node.full_name]:
            del self._names[node.full_name]
        self.changes.nodes_removed.append(node.id)

    def node_named(self, full_name: str) -> Node | None:
        """The oldest of that name."""
        return next(iter(self._names.get(full_name, {}).values()), None)

    def endpoint_with(self, gid: bytes) -> Publisher | Subscription | None:
        """The endpoint that users know by that gid. The newest one, if it came back before busd saw it go."""
        return self._gids.get(gid)

    def add_endpoint(self, endpoint: Publisher | Subscription) -> None:
        """Its topic is in the table from now on."""
        topic = self.topics.setdefault(endpoint.topic.name, endpoint.topic)
        peer = endpoint.node.peer
        if isinstance(endpoint, Publisher):
            topic.publishers[endpoint.id] = self.publishers[endpoint.id] = endpoint
            topic.guest_publishers += peer.is_guest
        else:
            topic.subscriptions[endpoint.id] = self.subscriptions[endpoint.id] = endpoint
            topic.guest_subscriptions += peer.is_guest
        self._gids[endpoint.shown_gid] = endpoint
        endpoint.node.endpoints[endpoint.id] = peer.endpoints[endpoint.id] = endpoint
        peer.user.endpoints += 1
        for holder in (peer, peer.user):
            holder.topics[topic.name] = holder.topics.get(topic.name, 0) + 1
        self.changes.endpoints_added.append(endpoint.record())

    def withdraw(self, endpoint: Publisher | Subscription) -> None:
        """From now on nothing new matches the endpoint. May be called again."""
        topic, is_guest = endpoint.topic, endpoint.node.peer.is_guest
        if isinstance(endpoint, Publisher):
            if topic.publishers.pop(endpoint.id, None) is not None:
                topic.guest_publishers -= is_guest
        elif topic.subscriptions.pop(endpoint.id, None) is not None:
            topic.guest_subscriptions -= is_guest
        if not topic.publishers and not topic.subscriptions and self.topics.get(topic.name) is topic:
            del self.topics[topic.name]

    def remove_endpoint(self, endpoint: Publisher | Subscription) -> None:
        """The endpoint must have been withdrawn, and its matches removed."""
        topic = endpoint.topic
        if isinstance(endpoint, Publisher):
            del self.publishers[endpoint.id]
            self._left_samples += endpoint.samples
            self._left_bytes += endpoint.bytes
        else:
            del self.subscriptions[endpoint.id]
        if self._gids.get(endpoint.shown_gid) is endpoint:
            del self._gids[endpoint.shown_gid]
        peer = endpoint.node.peer
        del endpoint.node.endpoints[endpoint.id], peer.endpoints[endpoint.id]
        peer.user.endpoints -= 1
        for holder in (peer, peer.user):
            holder.topics[topic.name] -= 1
            if not holder.topics[topic.name]:
                del holder.topics[topic.name]
        self.changes.endpoints_removed.append(endpoint.id)

    def add_match(self, match: Match, *, is_shared: bool, last_seq: int | None = None) -> None:
        """A new match: of a mirror, or on the route shm, or on the route socket.

        `last_seq`: the subscription is back, and the publisher sends the samples after this one to it alone.
        """
        publisher, subscription = match.publisher, match.subscription
        publisher.matches[subscription.id] = subscription.matches[publisher.id] = match
        if subscription.is_mirror:
            match.on(MatchEvent.BRIDGE)
        elif is_shared:
            match.share()
        elif last_seq is not None:
            match.repeat_from(last_seq)
        else:
            match.begin_routing()
        self._matches += 1
        _count_match(match, 1)
        self.changes.matches_added.append(match_record(match))

    def reroute(self, match: Match) -> None:
        """Move the match from the route shm to the route socket; it gets nothing by socket yet."""
        before = match_record(match)
        match.on(MatchEvent.REROUTE)
        self.changes.matches_removed.append(before)
        self.changes.matches_added.append(match_record(match))

    def remove_match(self, match: Match) -> int:
        """Returns the last number that the subscription has had or that was routed to it."""
        record = match_record(match)
        last_seq = match.end()
        self.changes.matches_removed.append(record)
        del match.publisher.matches[match.subscription.id], match.subscription.matches[match.publisher.id]
        self._matches -= 1
        _count_match(match, -1)
        return last_seq

    def routed(self) -> tuple[int, int]:
        """Samples and bytes that have come through the broker, of all publishers that ever were."""
        present = self.publishers.values()
        return (
            self._left_samples + sum(publisher.samples for publisher in present),
            self._left_bytes + sum(publisher.bytes for publisher in present),
        )

    def find_endpoint(self, number: EndpointId) -> Publisher | Subscription | None:
        """The endpoint of that number."""
        return self.publishers.get(number) or self.subscriptions.get(number)


def _count_match(match: Match, number: int) -> None:
    """Count it for both processes and users, each once. A guest's match counts for the guest alone, because a
    guest must not use up the quota of others.
    """
    one, other = match.publisher.node.peer, match.subscription.node.peer
    if one.is_guest is not other.is_guest:
        one = other = one if one.is_guest else other
    one.matches += number
    one.user.matches += number
    if other is not one:
        other.matches += number
        if other.user is not one.user:
            other.user.matches += number


def match_record(match: Match) -> MatchRecord:
    """As observers see it."""
    publisher, subscription = match.publisher.id, match.subscription.id
    return MatchRecord(publisher=publisher, subscription=subscription, route=ROUTE_OF[match.state])
