"""What the far buses have said they have, held against the bounds, and which of it is to be mirrored. Pure.

Names are those on the wire. Topics outside of the namespace, what no rule lets in, and what came through this
bus already is known here, but not to be mirrored.
"""

import msgspec

from bus_bridge.core.bounds import Bounds, News, wrong_bus, wrong_endpoint, wrong_node
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from bus_bridge.engine import FarBus, FarEndpoint, FarNode

__all__ = ["FarGraph", "Mirrored", "MirroredNode"]


class MirroredNode(msgspec.Struct, frozen=True):
    """A far node as it is to be shown here."""

    key: str
    name: str
    namespace: str
    bus: str
    """Whose bridge shows it."""
    via: tuple[str, ...]
    """The buses that it came through before, its own first; empty where it lives on `bus`."""

    @property
    def identity(self) -> tuple[object, ...]:
        """What stays the same of it when its bridge comes back."""
        return self.name, self.namespace, self.bus, self.via


class Mirrored(msgspec.Struct, frozen=True):
    """A far endpoint as it is to be shown here."""

    far: FarEndpoint
    node: MirroredNode
    topic: str
    """Its name on this bus."""


class _Bus:
    def __init__(self, bus: FarBus, news: News) -> None:
        self.bus = bus
        self.news = news
        self.nodes: dict[str, FarNode] = {}
        self.endpoints = 0
        self.types: set[tuple[str, str]] = set()


class FarGraph:
    """`own_bus` is the id of this bus.

    Methods that take news return what is wrong with them, in words, or "". Where something is, the far bus
    is to be refused, and to be taken out by `bus_went`.
    """

    def __init__(self, own_bus: str, bounds: Bounds, rules: Rules, naming: Naming) -> None:
        self._own_bus = own_bus
        self._bounds = bounds
        self._rules = rules
        self._naming = naming
        self._buses: dict[str, _Bus] = {}
        self._news: dict[str, News] = {}
        """Of those that have gone, too: who comes and goes all the time has the rate of one that stays."""
        self._nodes: dict[str, _Bus] = {}
        self._endpoints: dict[bytes, dict[str, FarEndpoint]] = {}
        self._by_node: dict[str, dict[bytes, None]] = {}
        self._known_nodes: dict[str, MirroredNode] = {}  # that may be mirrored
        self._outside: dict[str, int] = {}
        """Nodes outside of the namespace, and how many of their endpoints are inside: with one they are
        mirrored too, under the name that they have on the wire."""
        self.nodes: dict[str, MirroredNode] = {}
        """To be mirrored, by key."""
        self.endpoints: dict[bytes, Mirrored] = {}
        """To be mirrored, by gid: of two that have the same, the one that came first."""

    @property
    def buses(self) -> list[FarBus]:
        return [one.bus for one in self._buses.values()]

    def ways(self, gid: bytes) -> list[str]:
        """The buses by which an endpoint with this gid comes; not this one's own, by a way around."""
        return [self._nodes[key].bus.id for key in self._endpoints.get(gid, ()) if key in self._known_nodes]

    def bus_of(self, key: str) -> str:
        """The bus that told of a node; "" for none that is known."""
        known = self._nodes.get(key)
        return "" if known is None else known.bus.id

    def bus_came(self, bus: FarBus, now_s: float) -> str:
        if wrong := wrong_bus(bus):
            return wrong
        if bus.id == self._own_bus:
            return (
                f"its bus has the id '{bus.id}', as this one has; choose another with --id, or look whether "
                "both bridges are on the same bus"
            )
        if bus.id not in self._buses:
            if len(self._buses) >= self._bounds.buses:
                return f"there are {self._bounds.buses} far buses already, the most that this bridge takes"
            news = self._news.pop(bus.id, None) or News(self._bounds, now_s)
            self._news[bus.id] = news
            if len(self._news) > 2 * self._bounds.buses:
                del self._news[next(one for one in self._news if one not in self._buses and one != bus.id)]
            if news.is_too_much(now_s):
                return self._too_much()
            self._buses[bus.id] = _Bus(bus, news)
        self._buses[bus.id].bus = bus
        return ""

    def bus_went(self, bus_id: str) -> None:
        gone = self._buses.pop(bus_id, None)
        if gone is not None:
            for key in tuple(gone.nodes):
                self._forget_node(gone, key)

    def node_came(self, node: FarNode, now_s: float) -> str:
        bus = self._buses.get(node.bus)
        if bus is None:
            return ""
        if bus.news.is_too_much(now_s):
            return self._too_much()
        if wrong := wrong_node(node):
            return wrong
        known = self._nodes.get(node.key)
        if known is not None and known is not bus:
            return f"it names a node of '{known.bus.id}' as its own"
        if bus.nodes.get(node.key) == node:
            return ""
        if known is None and len(bus.nodes) >= self._bounds.nodes:
            return f"it has more than {self._bounds.nodes} nodes"
        if known is not None:
            self._forget_node(bus, node.key)
        bus.nodes[node.key] = node
        self._nodes[node.key] = bus
        if self._own_bus not in (node.bus, *node.via):
            namespace = self._naming.namespace_from_wire(node.namespace)
            mirrored = MirroredNode(node.key, node.name, namespace or node.namespace, node.bus, node.via)
            self._known_nodes[node.key] = mirrored
            if namespace is not None:
                self.nodes[node.key] = mirrored
            else:
                self._outside[node.key] = 0
        return ""

    def node_went(self, key: str, now_s: float) -> str:
        bus = self._nodes.get(key)
        if bus is None:
            return ""
        self._forget_node(bus, key)
        return self._too_much() if bus.news.is_too_much(now_s) else ""

    def endpoint_came(self, endpoint: FarEndpoint, now_s: float) -> str:
        bus = self._nodes.get(endpoint.node)
        if bus is None:
            return ""
        if bus.news.is_too_much(now_s):
            return self._too_much()
        if wrong := wrong_endpoint(endpoint):
            return wrong
        ways = self._endpoints.get(endpoint.gid, {})
        known = ways.get(endpoint.node)
        if known == endpoint:
            return ""
        if known is None and bus.endpoints >= self._bounds.endpoints:
            return f"it has more than {self._bounds.endpoints} endpoints"
        bus.types.add((endpoint.type_name, endpoint.type_hash))
        if len(bus.types) > self._bounds.types:
            return f"it has named more than {self._bounds.types} types"
        if known is None:
            bus.endpoints += 1
        self._endpoints.setdefault(endpoint.gid, {})[endpoint.node] = endpoint
        self._by_node.setdefault(endpoint.node, {})[endpoint.gid] = None
        self._choose(endpoint.gid)
        return ""

    def endpoint_went(self, gid: bytes, node: str, now_s: float) -> str:
        bus = self._nodes.get(node)
        if bus is None or node not in self._endpoints.get(gid, ()):
            return ""
        self._forget_endpoint(bus, gid, node)
        return self._too_much() if bus.news.is_too_much(now_s) else ""

    def _forget_node(self, bus: _Bus, key: str) -> None:
        for gid in tuple(self._by_node.get(key, ())):
            self._forget_endpoint(bus, gid, key)
        bus.nodes.pop(key, None)
        self._nodes.pop(key, None)
        self.nodes.pop(key, None)
        self._known_nodes.pop(key, None)
        self._outside.pop(key, None)

    def _forget_endpoint(self, bus: _Bus, gid: bytes, node: str) -> None:
        ways = self._endpoints[gid]
        del ways[node]
        if not ways:
            del self._endpoints[gid]
        gids = self._by_node[node]
        del gids[gid]
        if not gids:
            del self._by_node[node]
        bus.endpoints -= 1
        self._choose(gid)

    def _choose(self, gid: bytes) -> None:
        """By which way it is mirrored, if it is: the way that came first, for as long as that is there."""
        known = self.endpoints.pop(gid, None)
        ways = self._endpoints.get(gid, {})
        if known is not None and ways.get(known.far.node) is known.far:
            self.endpoints[gid] = known
            return
        if known is not None:
            self._count_outside(known.node.key, -1)
        for endpoint in ways.values():
            mirrored = self._mirrored(endpoint)
            if mirrored is not None:
                self.endpoints[gid] = mirrored
                self._count_outside(mirrored.node.key, 1)
                return

    def _count_outside(self, key: str, change: int) -> None:
        if key in self._outside:
            self._outside[key] += change
            if self._outside[key]:
                self.nodes[key] = self._known_nodes[key]
            else:
                self.nodes.pop(key, None)

    def _mirrored(self, endpoint: FarEndpoint) -> Mirrored | None:
        node, topic = self._known_nodes.get(endpoint.node), self._naming.topic_from_wire(endpoint.topic)
        if node is None or topic is None:
            return None
        crossing = self._rules.crossing(topic)
        # A far subscription is shown here where messages of this bus may go to it.
        if not (crossing.comes_in if endpoint.kind == "publisher" else crossing.goes_out):
            return None
        return Mirrored(endpoint, node, topic)

    def _too_much(self) -> str:
        return f"its nodes and endpoints come and go more than {self._bounds.news_per_s} times in a second"
