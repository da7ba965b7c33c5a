"""A copy of the graph: a snapshot, and all changes that busd has sent since.

Owns the copy, and the `Graph` made from it at request. Must not know its observers.
"""

from bus.errors import BusError, RemoteProtocolError
from bus.graph import Graph, GraphEndpoint, GraphMatch, GraphNode, endpoint_of, graph_of, match_of, node_of
from bus.wire import messages as m


class GraphMirror:
    """The copy of the graph. `failure` is the reason if busd did not send a snapshot."""

    def __init__(self) -> None:
        self.failure: BusError | TimeoutError | None = None
        self._graph: Graph | None = None
        self._revision = 0
        self._pid = 0
        self._nodes: dict[int, GraphNode] = {}
        self._publishers: dict[int, GraphEndpoint] = {}
        self._subscriptions: dict[int, GraphEndpoint] = {}
        self._taps: dict[int, GraphEndpoint] = {}
        self._matches: dict[GraphMatch, None] = {}
        self._is_begun = False
        self._early: list[m.GraphChanged] = []
        """Changes that came in the same read as the snapshot."""

    def begin(self, snapshot: m.GraphSnapshot) -> None:
        """Begin with a snapshot. Raises RemoteProtocolError if busd contradicts itself."""
        graph = graph_of(snapshot)
        self._nodes = {one.id: one for one in graph.nodes}
        self._publishers = {one.id: one for one in graph.publishers}
        self._subscriptions = {one.id: one for one in graph.subscriptions}
        self._taps = {one.id: one for one in graph.taps}
        self._matches = dict.fromkeys(graph.matches)
        self._revision, self._pid = graph.revision, graph.broker_pid
        self._graph, self._is_begun = graph, True
        early, self._early = self._early, []
        for change in early:
            self.change(change)

    def change(self, change: m.GraphChanged) -> None:
        """Apply a change. Raises RemoteProtocolError if busd contradicts itself."""
        if not self._is_begun:
            self._early.append(change)
            return
        if change.revision <= self._revision:
            return
        # A node added and removed within one change is in both lists.
        self._nodes.update((one.id, node_of(one)) for one in change.nodes_added)
        tables = {"publisher": self._publishers, "subscription": self._subscriptions, "tap": self._taps}
        for one in change.endpoints_added:
            if one.node not in self._nodes:
                raise RemoteProtocolError(
                    f"busd told of an endpoint of node {one.node}, which it never named"
                )
            if (table := tables.get(one.kind)) is not None:
                table[one.id] = endpoint_of(one, self._nodes)
        self._matches.update((match_of(one), None) for one in change.matches_added)
        for gone in change.matches_removed:
            self._matches.pop(match_of(gone), None)
        for number in change.endpoints_removed:
            self._publishers.pop(number, None)
            self._subscriptions.pop(number, None)
            self._taps.pop(number, None)
        for number in change.nodes_removed:
            self._nodes.pop(number, None)
        self._revision = change.revision
        self._graph = None

    @property
    def graph(self) -> Graph | None:
        """The present graph, the same object until it changes; None before the first snapshot."""
        if self._graph is None and self._is_begun:
            self._graph = Graph(
                revision=self._revision,
                broker_pid=self._pid,
                nodes=tuple(self._nodes.values()),
                publishers=tuple(self._publishers.values()),
                subscriptions=tuple(self._subscriptions.values()),
                matches=tuple(self._matches),
                taps=tuple(self._taps.values()),
            )
        return self._graph
