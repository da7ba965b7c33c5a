"""Nodes and endpoints announced by far buses, checked against the bounds, and the choice of the mirrored
ones. Pure.

Names are names on the wire. Some endpoints are known here but not mirrored: endpoints outside of the
namespace, endpoints that the rules forbid, and endpoints that came through this bus before.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from bus.qos import QoSProfile
from bus_bridge.checks import wrong_bus, wrong_endpoint, wrong_node
from bus_bridge.core.bounds import Bounds, News
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, RouteRule

__all__ = ["FarGraph", "Mirrored", "MirroredNode", "Wrong"]

_MANY: Final = 10
"""An announcer with a tenth of the nodes or endpoints that a bus may have has many of them."""


class MirroredNode(msgspec.Struct, frozen=True):
    """A far node as this bus shows it."""

    key: str
    name: str
    namespace: str
    bus: str
    """The bus of the bridge that shows it."""
    via: tuple[str, ...]
    """The buses that it came through before, starting with its own; empty if it lives on `bus`."""
    announcer: str = ""
    """As of FarNode."""

    @property
    def clock(self) -> tuple[str, ...]:
        """The clock of its messages' times: of its bus, or of its part of a bus with several independent
        ones."""
        return self.bus, *self.via[:1], self.announcer

    @property
    def identity(self) -> tuple[object, ...]:
        """The part of its identity that stays the same after a restart of its bridge."""
        return self.name, self.namespace, self.bus, self.via


class Mirrored(msgspec.Struct, frozen=True):
    """A far endpoint as this bus shows it."""

    far: FarEndpoint
    node: MirroredNode
    topic: str
    """The name of the topic on this bus."""
    qos: QoSProfile
    """The QoS of its mirror."""
    rule: RouteRule


class Wrong(NamedTuple):
    """A fault in data of the far side, and the party to refuse: `announcer`, or the whole bus if that is
    empty."""

    bus: str
    announcer: str
    reason: str


class _Bus:
    def __init__(self, bus_id: str) -> None:
        self.id = bus_id
        self.announcers: dict[str, _Announcer] = {}
        self.nodes = 0
        self.endpoints = 0


class _Announcer:
    """A source of news about nodes: a whole bus, or a part of it that announces its own nodes."""

    def __init__(self, bus: _Bus, name: str, news: News) -> None:
        self.bus = bus
        self.name = name
        self.news = news
        self.nodes: dict[str, FarNode] = {}
        self.endpoints = 0
        self.types: set[tuple[str, str]] = set()

    def wrong(self, reason: str) -> Wrong:
        return Wrong(self.bus.id, self.name, reason)


class FarGraph:
    """The graph of all far buses. `own_bus` is the id of this bus.

    Methods for news return faults in the news. The caller then removes the refused party with `forget`. If a
    bus exceeds its limits, the fault names the announcer with most nodes and endpoints, or the newest one if
    none has many.
    """

    def __init__(self, own_bus: str, bounds: Bounds, rules: Rules, naming: Naming) -> None:
        self._own_bus = own_bus
        self._bounds = bounds
        self._rules = rules
        self._naming = naming
        self._buses: dict[str, _Bus] = {}
        self._news: dict[tuple[str, str], News] = {}
        """Rates of change by bus and announcer. They outlive their bus: else it could exceed the rate by
        coming and going."""
        self._nodes: dict[str, _Announcer] = {}
        self._endpoints: dict[bytes, dict[str, FarEndpoint]] = {}
        self._by_node: dict[str, dict[bytes, None]] = {}
        self._known_nodes: dict[str, MirroredNode] = {}  # candidates for mirrors
        self._outside: dict[str, int] = {}
        """Nodes outside of the namespace, and their number of endpoints inside. A node with such an endpoint
        is mirrored under its name on the wire."""
        self.nodes: dict[str, MirroredNode] = {}
        """Nodes to mirror, by key."""
        self.endpoints: dict[bytes, Mirrored] = {}
        """Endpoints to mirror, by gid. If two have the same gid, the first one counts."""

    @property
    def buses(self) -> list[str]:
        """Ids of the present far buses."""
        return [*self._buses]

    def ways(self, gid: bytes) -> list[str]:
        """The buses through which an endpoint with this gid arrives, except this bus itself."""
        return [self._nodes[key].bus.id for key in self._endpoints.get(gid, ()) if key in self._known_nodes]

    def reconfigure(self, rules: Rules, naming: Naming) -> None:
        """Apply other rules, and other far names. Endpoints for which nothing has changed stay as they
        are."""
        self._rules, self._naming = rules, naming
        for gid in tuple(self._endpoints):
            self._choose(gid)

    def knows(self, gid: bytes) -> bool:
        """Whether a far bus has an endpoint with this gid, even if it is not mirrored."""
        return gid in self._endpoints

    def wrong(self, key: str, reason: str) -> Wrong | None:
        """Make a fault for an endpoint of a node; None if the node has gone."""
        known = self._nodes.get(key)
        return None if known is None else known.wrong(reason)

    def bus_added(self, bus: FarBus, now_s: float) -> Wrong | None:
        wrong = wrong_bus(bus)
        if bus.id == self._own_bus:
            wrong = (
                f"its bus has the same id '{bus.id}' as this one; choose another with --id, or check "
                "whether both bridges are on the same bus"
            )
        elif bus.id not in self._buses and len(self._buses) >= self._bounds.buses:
            wrong = f"there are {self._bounds.buses} far buses already, which is the limit of this bridge"
        if wrong:
            return Wrong(bus.id, "", wrong)
        if bus.id in self._buses:
            return None
        made = self._buses[bus.id] = _Bus(bus.id)
        whole = made.announcers[""] = _Announcer(made, "", self._news_of(bus.id, "", now_s))
        if whole.news.is_too_much(now_s):
            del self._buses[bus.id]
            return self._too_much(whole)
        return None

    def bus_removed(self, bus_id: str) -> None:
        gone = self._buses.pop(bus_id, None)
        if gone is not None:
            for announcer in tuple(gone.announcers.values()):
                self._forget_announcer(announcer)

    def forget(self, wrong: Wrong) -> None:
        """Remove a refused bus or announcer."""
        if not wrong.announcer:
            self.bus_removed(wrong.bus)
        elif (bus := self._buses.get(wrong.bus)) is not None and wrong.announcer in bus.announcers:
            self._forget_announcer(bus.announcers[wrong.announcer])

    def node_added(self, node: FarNode, now_s: float) -> Wrong | None:
        bus = self._buses.get(node.bus)
        if bus is None:
            return None
        announcer = bus.announcers.get(node.announcer)
        if announcer is None:
            announcer = _Announcer(bus, node.announcer, self._news_of(node.bus, node.announcer, now_s))
            bus.announcers[node.announcer] = announcer
        if announcer.news.is_too_much(now_s):
            return self._too_much(announcer)
        if wrong := wrong_node(node):
            return announcer.wrong(wrong)
        known = self._nodes.get(node.key)
        if known is not None and known is not announcer:
            return announcer.wrong(f"it names a node of '{known.name or known.bus.id}' as its own")
        if announcer.nodes.get(node.key) == node:
            return None
        if known is not None:
            self._forget_node(announcer, node.key)
        bus.nodes += 1
        announcer.nodes[node.key] = node
        self._nodes[node.key] = announcer
        if self._own_bus not in (node.bus, *node.via):
            namespace = self._naming.namespace_from_wire(node.namespace)
            shown = namespace or node.namespace
            mirrored = MirroredNode(node.key, node.name, shown, node.bus, node.via, node.announcer)
            self._known_nodes[node.key] = mirrored
            if namespace is not None:
                self.nodes[node.key] = mirrored
            else:
                self._outside[node.key] = 0
        if bus.nodes > self._bounds.nodes:
            return _excess(bus, self._bounds.nodes, "nodes", lambda one: len(one.nodes))
        return None

    def node_removed(self, key: str, now_s: float) -> Wrong | None:
        announcer = self._nodes.get(key)
        if announcer is None:
            return None
        self._forget_node(announcer, key)
        wrong = self._too_much(announcer) if announcer.news.is_too_much(now_s) else None
        if announcer.name and not announcer.nodes and wrong is None:
            self._forget_announcer(announcer)
        return wrong

    def endpoint_added(self, endpoint: FarEndpoint, now_s: float) -> Wrong | None:
        announcer = self._nodes.get(endpoint.node)
        if announcer is None:
            return None
        if announcer.news.is_too_much(now_s):
            return self._too_much(announcer)
        if wrong := wrong_endpoint(endpoint):
            return announcer.wrong(wrong)
        known = self._endpoints.get(endpoint.gid, {}).get(endpoint.node)
        if known == endpoint:
            return None
        announcer.types.add((endpoint.type_name, endpoint.type_hash))
        if len(announcer.types) > self._bounds.types:
            return announcer.wrong(f"it has named more than {self._bounds.types} types")
        if known is None:
            announcer.endpoints += 1
            announcer.bus.endpoints += 1
        self._endpoints.setdefault(endpoint.gid, {})[endpoint.node] = endpoint
        self._by_node.setdefault(endpoint.node, {})[endpoint.gid] = None
        self._choose(endpoint.gid)
        if announcer.bus.endpoints > self._bounds.endpoints:
            return _excess(announcer.bus, self._bounds.endpoints, "endpoints", lambda one: one.endpoints)
        return None

    def endpoint_removed(self, gid: bytes, node: str, now_s: float) -> Wrong | None:
        announcer = self._nodes.get(node)
        if announcer is None or node not in self._endpoints.get(gid, ()):
            return None
        self._forget_endpoint(announcer, gid, node)
        return self._too_much(announcer) if announcer.news.is_too_much(now_s) else None

    def _news_of(self, bus: str, announcer: str, now_s: float) -> News:
        known = self._news
        found = known.pop((bus, announcer), None) or News(self._bounds, now_s)
        known[bus, announcer] = found
        if len(known) > 2 * (self._bounds.buses + self._bounds.nodes):
            here = {(one.id, name) for one in self._buses.values() for name in one.announcers}
            del known[next(one for one in known if one not in here and one != (bus, announcer))]
        return found

    def _forget_announcer(self, announcer: _Announcer) -> None:
        for key in tuple(announcer.nodes):
            self._forget_node(announcer, key)
        announcer.bus.announcers.pop(announcer.name, None)

    def _forget_node(self, announcer: _Announcer, key: str) -> None:
        for gid in tuple(self._by_node.get(key, ())):
            self._forget_endpoint(announcer, gid, key)
        if announcer.nodes.pop(key, None) is not None:
            announcer.bus.nodes -= 1
        self._nodes.pop(key, None)
        self.nodes.pop(key, None)
        self._known_nodes.pop(key, None)
        self._outside.pop(key, None)

    def _forget_endpoint(self, announcer: _Announcer, gid: bytes, node: str) -> None:
        ways = self._endpoints[gid]
        del ways[node]
        if not ways:
            del self._endpoints[gid]
        gids = self._by_node[node]
        del gids[gid]
        if not gids:
            del self._by_node[node]
        announcer.endpoints -= 1
        announcer.bus.endpoints -= 1
        self._choose(gid)

    def _choose(self, gid: bytes) -> None:
        """Choose the way by which an endpoint is mirrored, if any: the first one, as long as it exists."""
        known = self.endpoints.pop(gid, None)
        ways = self._endpoints.get(gid, {})
        if (
            known is not None
            and ways.get(known.far.node) is known.far
            and self._mirrored(known.far) == known  # otherwise the rules have changed
        ):
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
        # This bus shows a far subscription only if messages may go out to it.
        if not (crossing.comes_in if endpoint.kind == "publisher" else crossing.goes_out):
            return None
        qos = crossing.qos_of(endpoint.kind, endpoint.qos)
        return Mirrored(endpoint, node, topic, qos, crossing.rule)

    def _too_much(self, announcer: _Announcer) -> Wrong:
        rate = self._bounds.news_per_s
        return announcer.wrong(f"its nodes and endpoints come and go more than {rate} times in a second")


def _excess(bus: _Bus, bound: int, what: str, count_of: Callable[[_Announcer], int]) -> Wrong:
    """The fault of a bus with more than `bound` nodes or endpoints: the announcer with most of them is wrong.

    Exception: if no announcer has many, the newest one is wrong. Some programs can announce under any number
    of names; the programs that were there before them stay.
    """
    most = max(bus.announcers.values(), key=count_of)
    count = count_of(most)
    if count > bound:
        return most.wrong(f"it has more than {bound} {what}")
    if count * _MANY >= bound:
        return most.wrong(
            f"its bus has more than {bound} {what}, and it has {count} of them, more than any other"
        )
    newest = next(one for one in reversed(bus.announcers.values()) if count_of(one))
    return newest.wrong(f"its bus has more than {bound} {what}, and it came last")
