"""The part of this bus that the far side may see, and its changes since the last graph. Pure."""

import msgspec

from bus.endpoint.matches import Match
from bus.errors import ConfigurationError
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.names import split_node_name
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Crossing, Rules
from bus_bridge.core.status import SERVICE_TYPE
from bus_bridge.engine import EndpointKind, LocalEndpoint, LocalNode, RouteRule

__all__ = ["Changes", "LocalGraph", "Shown"]

_Key = tuple[object, ...]
"""Key of a node: process, namespace, name and origin."""


class Shown(msgspec.Struct, frozen=True):
    """An endpoint of this bus that the far side may see."""

    local: LocalEndpoint
    topic: str
    """The name of the topic on this bus."""
    node: str
    """Full name of the node on this bus."""
    rule: RouteRule


class Changes(msgspec.Struct):
    """Changes in the order in which they must be announced: removals, then nodes, subscriptions and
    publishers.

    So the subscription for a client's answers reaches the far side before its request.
    """

    gone: list[Shown] = []
    gone_nodes: list[LocalNode] = []
    nodes: list[LocalNode] = []
    subscriptions: list[Shown] = []
    publishers: list[Shown] = []
    warnings: list[str] = []


class LocalGraph:
    """The graph of this bus as the far side sees it.

    It identifies endpoints by gid, and nodes by process and name, so a restart of busd changes nothing.
    `far_bus` is the id of the only bus on the far side. That bus must not see its own nodes again.
    """

    def __init__(self, rules: Rules, naming: Naming, far_bus: str = "") -> None:
        self._rules = rules
        self._naming = naming
        self._far_bus = far_bus
        self._has_other_rules = False
        self._node_numbers = 0
        self._nodes: dict[int, tuple[_Key, LocalNode | None]] = {}  # by busd's number of the node
        self._absent: dict[_Key, list[LocalNode]] = {}
        """Nodes of an earlier busd that the current busd does not know yet."""
        self._seen: dict[bytes, GraphEndpoint] = {}
        self._seen_at: tuple[int, int] = (0, -1)
        self.endpoints: dict[bytes, Shown] = {}
        """The endpoints that the far side may see now, by gid."""

    def knows(self, gid: bytes) -> bool:
        """Whether the last graph had this endpoint, visible to the far side or not."""
        return gid in self._seen

    def hides(self, gid: bytes) -> bool:
        """Whether the last graph had this endpoint and the far side must not see it."""
        return gid in self._seen and gid not in self.endpoints

    def give_up(self, gid: bytes) -> None:
        """Remove an endpoint that can't be shown to the far side."""
        self.endpoints.pop(gid, None)

    def reconfigure(self, rules: Rules, naming: Naming) -> None:
        """Apply other rules, and other far names, from the next `update` on."""
        self._rules, self._naming = rules, naming
        self._has_other_rules = True

    def is_other_busd(self, graph: Graph) -> bool:
        """Whether `graph` comes from a new busd. Most endpoints that are missing in it will come back."""
        pid, revision = self._seen_at
        return revision >= 0 and (pid != graph.broker_pid or graph.revision < revision)

    @property
    def nodes(self) -> list[LocalNode]:
        """Nodes that the far side may see now."""
        return [node for _, node in self._nodes.values() if node is not None]

    def update(self, graph: Graph, *, keeps: bool = False) -> Changes:
        """Update to `graph`; returns the changes. With `keeps`, nothing is removed: missing nodes and
        endpoints may come back."""
        changes = Changes()
        looks_at_all = keeps or self.is_other_busd(graph) or self._has_other_rules
        present = {one.gid: one for one in graph.subscriptions}
        present.update((one.gid, one) for one in graph.publishers)
        if self.is_other_busd(graph):
            for key, node in self._nodes.values():
                if node is not None:
                    self._absent.setdefault(key, []).append(node)
            self._nodes.clear()
        self._seen_at = graph.broker_pid, graph.revision
        self._update_nodes(graph, changes)
        if not keeps:
            for gid in self._seen.keys() - present.keys():
                del self._seen[gid]
                if (gone := self.endpoints.pop(gid, None)) is not None:
                    changes.gone.append(gone)
            changes.gone_nodes += [node for nodes in self._absent.values() for node in nodes]
            self._absent.clear()
        for gid, endpoint in present.items():
            seen = self._seen.get(gid)
            # A mirror that came another way may have replaced another node's endpoint between two graphs.
            if looks_at_all or seen is None or seen.id != endpoint.id:
                self._update_endpoint(endpoint, changes)
        self._has_other_rules = False
        return changes

    def add_short(self, match: Match, kind: tuple[str, str, str]) -> Changes:
        """Add a publisher of this bus, with its node, that came and left between two graphs."""
        changes = Changes()
        topic, type_name, type_hash = kind
        namespace, name = split_node_name(match.node)
        node = self._make_node(GraphNode(id=0, name=name, namespace=namespace, pid=0), changes)
        crossing = self._rules.crossing(topic)
        if node is None or not crossing.goes_out or self.knows(match.gid):
            return Changes()
        wire = self._to_wire(topic, changes)
        if wire is not None:
            qos = crossing.qos_of("publisher", match.qos)
            local = LocalEndpoint("publisher", match.gid, node, wire, type_name, type_hash, qos)
            changes.publishers.append(Shown(local, topic, match.node, crossing.rule))
        return changes

    def _update_endpoint(self, endpoint: GraphEndpoint, changes: Changes) -> None:
        gid = endpoint.gid
        self._seen[gid] = endpoint
        known, shown = self.endpoints.pop(gid, None), self._show(endpoint, changes)
        if shown is not None:
            self.endpoints[gid] = shown
        if shown == known:
            return
        if known is not None:
            changes.gone.append(known)
        if shown is not None:
            is_publisher = shown.local.kind == "publisher"
            (changes.publishers if is_publisher else changes.subscriptions).append(shown)

    def _update_nodes(self, graph: Graph, changes: Changes) -> None:
        present = {one.id: one for one in graph.nodes}
        for number in self._nodes.keys() - present.keys():
            _, node = self._nodes.pop(number)
            if node is not None:
                changes.gone_nodes.append(node)
        transits: set[int] = set()
        if self._rules.has_transit:
            transits = {
                one.node.id
                for one in (*graph.publishers, *graph.subscriptions)
                if one.node.origin is not None and self._crossing(one) is not None
            }
        if self._has_other_rules:
            out = [number for number in self._nodes if present[number].origin and number not in transits]
            changes.gone_nodes += [node for number in out if (node := self._nodes.pop(number)[1])]
        for number in present.keys() - self._nodes.keys():
            found = present[number]
            if found.origin is not None and number not in transits:
                continue
            key = (found.pid, found.namespace, found.name, found.origin)
            if absent := self._absent.get(key):
                local: LocalNode | None = absent.pop()
            elif (local := self._make_node(found, changes)) is not None:
                changes.nodes.append(local)
            self._nodes[number] = key, local

    def _make_node(self, node: GraphNode, changes: Changes) -> LocalNode | None:
        try:
            namespace = self._naming.namespace_to_wire(node.namespace)
        except ConfigurationError as error:
            changes.warnings.append(f"node {node.full_name} is not seen on the far side: {error}")
            return None
        self._node_numbers += 1
        via = () if node.origin is None else (*node.origin.via, node.origin.bus)
        return LocalNode(self._node_numbers, node.name, namespace, via)

    def _crossing(self, endpoint: GraphEndpoint) -> Crossing | None:
        """The crossing of an endpoint; None if the far side must not see it."""
        crossing = self._rules.crossing(endpoint.topic)
        if not (crossing.goes_out if endpoint.kind == "publisher" else crossing.comes_in):
            return None
        origin = endpoint.node.origin
        if origin is not None and (not crossing.rule.transit or origin.bus == self._far_bus):
            return None
        if endpoint.type_name.startswith(SERVICE_TYPE):  # every bus has its own bridges' status services
            return None
        return crossing

    def _show(self, endpoint: GraphEndpoint, changes: Changes) -> Shown | None:
        crossing = self._crossing(endpoint)
        if crossing is None:
            return None
        _, node = self._nodes.get(endpoint.node.id, (None, None))
        if node is None:
            return None
        topic = self._to_wire(endpoint.topic, changes)
        if topic is None:
            return None
        kind: EndpointKind = "publisher" if endpoint.kind == "publisher" else "subscription"
        qos = crossing.qos_of(kind, endpoint.qos)
        local = LocalEndpoint(kind, endpoint.gid, node, topic, endpoint.type_name, endpoint.type_hash, qos)
        return Shown(local, endpoint.topic, endpoint.node.full_name, crossing.rule)

    def _to_wire(self, topic: str, changes: Changes) -> str | None:
        try:
            return self._naming.topic_to_wire(topic)
        except ConfigurationError as error:
            changes.warnings.append(f"'{topic}' does not cross: {error}")
            return None
