"""The part of the graph that one observer with limited access sees.

It sees the endpoints on the topics that it may observe, and the endpoints of its process. It sees the nodes
of these endpoints, and its own nodes. It sees a match if it sees both ends. Owns the list of records sent to
an observer, so its copy stays exact. Must not know why a topic is hidden.
"""

from collections import Counter
from collections.abc import Callable, Generator, Sequence

from bus.base.ids import EndpointId, NodeId
from bus.wire.messages import EndpointRecord, GraphChanged, MatchRecord
from busd.core.entities import Endpoint, MessageType, Peer, Publisher, Subscription
from busd.core.graph import Graph, match_record
from busd.core.work import TELL, Work


class GraphView:
    """The part of `graph` that `peer` sees, after `fill`; `ask_again` takes up other rules."""

    def __init__(self, graph: Graph, peer: Peer, may_observe: Callable[[str], bool]) -> None:
        self._graph = graph
        self._peer = peer
        self._may_observe = may_observe
        self._endpoints: dict[int, int] = {}
        """The shown endpoints, each with its node."""
        self._nodes: Counter[int] = Counter()
        """The shown nodes, each with the number of its shown endpoints; one more for the observer's own
        nodes.
        """

    def fill(self) -> Work:
        """Look at the whole graph; `changed` takes up the changes made meanwhile."""
        self._endpoints.clear()
        self._nodes.clear()
        self._nodes.update([*self._peer.nodes])
        tables: tuple[dict[EndpointId, Publisher] | dict[EndpointId, Subscription], ...]
        tables = (self._graph.publishers, self._graph.subscriptions)
        for table in tables:
            for endpoint in tuple(table.values()):
                if endpoint.id in table and endpoint.id not in self._endpoints:
                    if self._may_see(endpoint):
                        self._show(endpoint.id, endpoint.node.id)
                    yield TELL

    @property
    def shown(self) -> tuple[set[int], set[int]]:
        """The nodes and the endpoints that are seen now."""
        return {*self._nodes}, {*self._endpoints}

    def shows_type(self, kind: MessageType) -> Generator[int, int, bool]:
        """Whether an endpoint that is seen has that type, or this process has declared it. Work."""
        if kind in self._peer.types:
            return True
        for number in tuple(self._endpoints):
            present = self._graph.find_endpoint(EndpointId(number))
            if present is not None and present.type == kind:
                return True
            yield 1
        return False

    def changed(self, change: GraphChanged) -> GraphChanged:
        """The part of `change`, just made, that this observer sees: maybe only the revision."""
        nodes_gone, gone = {*change.nodes_removed}, {*change.endpoints_removed}
        own = [node.id for node in change.nodes_added if node.id in self._peer.nodes]
        added = [one for one in change.endpoints_added if one.id not in gone and self._is_seen(one)]
        removed = tuple(number for number in change.endpoints_removed if number in self._endpoints)
        touched = {*own, *nodes_gone, *(one.node for one in added)}
        touched.update(self._endpoints[number] for number in removed)
        before = {one for one in touched if one in self._nodes}
        for number in own:
            self._nodes[number] += 1
        for endpoint in added:
            self._show(endpoint.id, endpoint.node)
        matches_added = tuple(filter(self._sees_both, change.matches_added))
        matches_removed = tuple(filter(self._sees_both, change.matches_removed))
        for number in removed:
            self._hide(number)
        for number in nodes_gone:
            self._nodes.pop(number, None)
        nodes, after = self._graph.nodes, {one for one in touched if one in self._nodes}
        return GraphChanged(
            revision=change.revision,
            nodes_added=tuple(nodes[NodeId(one)].record() for one in sorted(after - before)),
            nodes_removed=tuple(sorted(before - after)),
            endpoints_added=tuple(added),
            endpoints_removed=removed,
            matches_added=matches_added,
            matches_removed=matches_removed,
        )

    def ask_again(self, few: Sequence[Publisher | Subscription], revision: int) -> GraphChanged | None:
        """Ask for the topics of `few`, which are in the graph, once more.

        Returns the records that become visible or hidden, as `revision`; None if none does.
        """
        fresh = [one for one in few if one.id not in self._endpoints and self._may_see(one)]
        gone = [one for one in few if one.id in self._endpoints and not self._may_see(one)]
        if not fresh and not gone:
            return None
        touched = {one.node.id for one in (*fresh, *gone)}
        before = {one for one in touched if one in self._nodes}
        matches_removed = self._matches(gone)
        for one in gone:
            self._hide(one.id)
        for one in fresh:
            self._show(one.id, one.node.id)
        after = {one for one in touched if one in self._nodes}
        return GraphChanged(
            revision=revision,
            nodes_added=tuple(self._graph.nodes[one].record() for one in sorted(after - before)),
            nodes_removed=tuple(sorted(before - after)),
            endpoints_added=tuple(one.record() for one in fresh),
            endpoints_removed=tuple(one.id for one in gone),
            matches_added=self._matches(fresh),
            matches_removed=matches_removed,
        )

    def _may_see(self, endpoint: Endpoint) -> bool:
        return endpoint.node.peer is self._peer or self._may_observe(endpoint.topic.name)

    def _is_seen(self, endpoint: EndpointRecord) -> bool:
        return endpoint.id in self._peer.endpoints or self._may_observe(endpoint.topic)

    def _show(self, endpoint: int, node: int) -> None:
        self._endpoints[endpoint] = node
        self._nodes[node] += 1

    def _hide(self, endpoint: int) -> None:
        node = self._endpoints.pop(endpoint)
        self._nodes[node] -= 1
        if not self._nodes[node]:
            del self._nodes[node]

    def _sees_both(self, match: MatchRecord) -> bool:
        return match.publisher in self._endpoints and match.subscription in self._endpoints

    def _matches(self, few: Sequence[Publisher | Subscription]) -> tuple[MatchRecord, ...]:
        """The seen matches of `few`, each once."""
        records = (match_record(match) for one in few for match in one.matches.values())
        return tuple(dict.fromkeys(filter(self._sees_both, records)))
