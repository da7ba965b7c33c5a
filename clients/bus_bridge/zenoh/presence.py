"""The present buses with their nodes and endpoints, from tokens that come and go in any order. Pure.

Reports to a FarSide, in an order that it can follow: a bus, its nodes, its subscriptions, its publishers.

Every admitted bridge may write any token, and a token does not prove its author. So the first bridge with the
id of a bus keeps the id until it goes. A restarted bridge waits until the remains of its predecessor have
gone. If a bridge claims the id of another bus, it waits without effect. Also within a run, the first token
for a thing counts until it goes, and an unreadable token has no effect. A fault in a run only affects that
run.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from bus_bridge.checks import wrong_endpoint, wrong_node
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, FarSide
from bus_bridge.zenoh.groups import own_part, read_run
from bus_bridge.zenoh.keys import (
    VERSION,
    Broken,
    BusToken,
    EndpointToken,
    InterestToken,
    NodeToken,
    OtherVersion,
    Token,
    parse_token,
)

__all__ = ["MAX_RUNS", "MAX_TOKENS", "Interest", "Presence"]

_PATIENCE = 15
"""After so many checks, a run is no rest of a killed bridge, and does not wait for such a rest to vanish."""

MAX_TOKENS = 100_000
"""The most tokens of one bus. It bounds memory here, and is far above the bridge's own limit."""
MAX_RUNS = 1024
"""The most bridges; a restarted bridge counts again. It also bounds memory."""


class Interest(NamedTuple):
    """A bus that takes messages of one of our publishers; `run` is the run of its bridge."""

    bus: str
    run: str


class _Run:
    """A bridge of a bus, from its start to its end."""

    def __init__(self, bus: str, run: str) -> None:
        self.bus, self.run = bus, run
        self.began = own_part(run)
        """Later runs of a bus sort after earlier ones."""
        self.groups = read_run(run)
        self.token: BusToken | None = None
        self.nodes: dict[str, FarNode] = {}
        self.endpoints: dict[tuple[bytes, str], FarEndpoint] = {}
        """Endpoints by gid and node."""
        self.interests: dict[str, bytes] = {}
        self.is_told = False
        self.refusal = ""

    @property
    def tokens(self) -> int:
        return len(self.nodes) + len(self.endpoints) + len(self.interests) + (self.token is not None)


class Presence:
    """All known buses. `own`: this bus, and the run of its bridge.

    `on_interest(gid)` is called if a change occurs in the set of buses that take messages of our publisher
    `gid`.
    """

    def __init__(self, own: str, run: str, far: FarSide, on_interest: Callable[[bytes], None]) -> None:
        self._own, self._run = own, run
        self._groups = read_run(run)
        self._far = far
        self._on_interest = on_interest
        self._runs: dict[tuple[str, str], _Run] = {}
        self._heard: dict[str, _Run] = {}
        """The run of each bus that was reported to the far side."""
        self._node_bus: dict[str, _Run] = {}
        self._interests: dict[bytes, set[Interest]] = {}
        self._doubles: dict[str, str] = {}
        """Runs of other bridges with the id of our bus, and their zenoh ids."""
        self._looks: dict[tuple[str, str], int] = {}
        """Runs of bridges with an id that belongs to another bus or ours, and the number of checks that saw
        them."""

    def came(self, key: str) -> None:
        """Handle a token that has come."""
        token = _checked(parse_token(key))
        match token:
            case OtherVersion(bus, version):
                self._far.warn(
                    f"bus '{bus}' speaks version {version} of the bridges' protocol, this one version "
                    f"{VERSION}: use the same busd on both sides"
                )
                return
            case Broken(bus, name, reason):
                if (bus, name) in self._runs:
                    self._far.warn(f"a token of bus '{bus}' is ignored: {reason}")
                return
        if token.bus == self._own:
            if isinstance(token, BusToken) and token.run != self._run and len(self._doubles) < MAX_RUNS:
                self._doubles[token.run] = token.zenoh_id
            return
        run = self._runs.get((token.bus, token.run))
        if run is None:
            does_see = read_run(token.run).sees(self._groups)
            if not does_see and (len(self._runs) >= MAX_RUNS or not isinstance(token, BusToken)):
                return
            if len(self._runs) >= MAX_RUNS and not self._make_room():
                self._far.warn(f"more than {MAX_RUNS} bridges announce themselves; further ones are ignored")
                return
            run = self._runs[token.bus, token.run] = _Run(token.bus, token.run)
        if run.refusal:
            return
        if run.tokens >= MAX_TOKENS:
            self._refuse(run, f"it has announced more than {MAX_TOKENS} tokens")
            return
        match token:
            case BusToken():
                run.token = run.token or token
                if run.groups.sees(self._groups):
                    self._add_run(run)
                else:
                    self._refuse(run, "its --see does not name the group of this bus (--group)")
            case NodeToken(_, _, node):
                if node.key not in run.nodes:
                    run.nodes[node.key] = node
                    self._node_bus[node.key] = run
                    if run.is_told:
                        self._announce_node(run, node)
            case EndpointToken(_, _, endpoint):
                if (endpoint.gid, endpoint.node) not in run.endpoints:
                    run.endpoints[endpoint.gid, endpoint.node] = endpoint
                    if run.is_told and endpoint.node in run.nodes:
                        self._far.endpoint_added(endpoint)
            case InterestToken(_, _, of, gid):
                if of == self._own and key not in run.interests:
                    run.interests[key] = gid
                    self._interests.setdefault(gid, set()).add(Interest(run.bus, run.run))
                    self._on_interest(gid)

    def went(self, key: str) -> None:
        """Handle a token that has gone."""
        token = parse_token(key)
        if isinstance(token, OtherVersion | Broken):
            return
        if token.bus == self._own:
            if isinstance(token, BusToken):
                self._doubles.pop(token.run, None)
            return
        run = self._runs.get((token.bus, token.run))
        if run is None:
            return
        match token:
            case BusToken():
                if run.token is None or run.token == token:
                    run.token = None
                    run.refusal = ""
                    self._remove_run(run, "its bridge has gone, or can't be reached")
            case NodeToken(_, _, node):
                if run.nodes.get(node.key) == node:
                    del run.nodes[node.key]
                    self._node_bus.pop(node.key, None)
                    if run.is_told:
                        self._far.node_removed(node.key)
            case EndpointToken(_, _, endpoint):
                if run.endpoints.get((endpoint.gid, endpoint.node)) == endpoint:
                    del run.endpoints[endpoint.gid, endpoint.node]
                    if run.is_told and endpoint.node in run.nodes:
                        self._far.endpoint_removed(endpoint.gid, endpoint.node)
            case InterestToken(_, _, _, gid):
                if run.interests.pop(key, None) is not None:
                    self._lose_interest(run, gid)
        if not run.tokens and not run.refusal:
            del self._runs[run.bus, run.run]

    def refuse(self, bus: str, reason: str, run: str = "") -> None:
        """Ignore this run of the bus's bridge from now on; without `run`, the run that is in use."""
        known = self._runs.get((bus, run)) if run else self._heard.get(bus)
        if known is not None:
            self._refuse(known, reason)

    def poll(self, linked: Mapping[str, str] | None) -> None:
        """Warn about a bridge that claims the id of another bus. Call this about once a second.

        `linked`: the zenoh id of each bridge with a link, and its host if the end of a killed bridge there
        would be noticed late, otherwise "". None if bridges are reached without links.
        """
        rivals = [(self._own, run) for run in self._doubles]
        for run in self._runs.values():
            if run.token is not None and not run.refusal and not run.is_told:
                rivals.append((run.bus, run.run))
        if linked is not None:
            for bus, name in rivals:
                if bus != self._own:
                    self._check_links(bus, self._runs[bus, name], linked)
        self._looks = {one: self._looks.get(one, 0) + 1 for one in rivals}
        for (bus, name), looks in self._looks.items():
            if bus == self._own:
                # It has a link, so it is not the remains of our own bridge.
                is_linked = linked is not None and self._doubles[name] in linked
                if own_part(name) > own_part(self._run) or is_linked or looks > _PATIENCE:
                    self._far.warn(
                        f"another bus has the id '{bus}' too, so neither sees the other: give one of them "
                        "another id with --id"
                    )
            elif looks > _PATIENCE and not self._runs[bus, name].is_told:
                self._refuse(self._runs[bus, name], f"another bus has the id '{bus}', and came first")
                self._far.warn(
                    f"two buses have the id '{bus}', and this bridge uses the first one: give the other one "
                    "another id with --id"
                )

    @property
    def doubles(self) -> list[str]:
        """The zenoh ids of other bridges with the id of our bus."""
        return list(self._doubles.values())

    def _check_links(self, bus: str, rival: _Run, linked: Mapping[str, str]) -> None:
        """Check whether the owner of an id has gone although its token still exists."""
        run = self._heard.get(bus)
        if run is None or run.token is None or rival.token is None:
            return
        host = linked.get(run.token.zenoh_id)
        reason = ""
        if host is None:
            reason = "no link leads to it any more"
        elif host and rival.began > run.began and linked.get(rival.token.zenoh_id) == host:
            reason = "its bridge has restarted"
        if reason:
            run.token = None
            self._remove_run(run, reason)

    def _refuse(self, run: _Run, reason: str) -> None:
        if not run.refusal:
            run.refusal = reason
            self._remove_run(run, reason)
            self._clear(run)

    def _clear(self, run: _Run) -> None:
        for gid in run.interests.values():
            self._lose_interest(run, gid)
        for key in run.nodes:
            self._node_bus.pop(key, None)
        run.nodes.clear()
        run.endpoints.clear()
        run.interests.clear()

    def _make_room(self) -> bool:
        """Forget a bridge that does not see this bus, or has tokens of endpoints but no token itself."""
        for key, run in self._runs.items():
            if run.token is None or not run.groups.sees(self._groups):
                self._clear(run)
                del self._runs[key]
                return True
        return False

    def _lose_interest(self, run: _Run, gid: bytes) -> None:
        known = self._interests[gid]
        known.discard(Interest(run.bus, run.run))
        if not known:
            del self._interests[gid]
        self._on_interest(gid)

    # --- known buses and nodes

    def interests(self, gid: bytes) -> frozenset[Interest]:
        """The buses that take messages of our publisher."""
        return frozenset(self._interests.get(gid, ()))

    def bus_of(self, node: str) -> str | None:
        """The bus of a far node."""
        run = self._node_bus.get(node)
        return None if run is None else run.bus

    def buses(self) -> list[tuple[str, str, str]]:
        """Id, zenoh id and reason of refusal of each known bus."""
        return [
            (run.bus, run.token.zenoh_id, run.refusal) for run in self._runs.values() if run.token is not None
        ]

    # --- one bus

    def _add_run(self, run: _Run) -> None:
        if run.bus in self._heard:
            return
        self._heard[run.bus] = run
        run.is_told = True
        self._far.bus_added(FarBus(run.bus))
        for node in run.nodes.values():
            self._far.node_added(node)
        self._announce_endpoints(one for one in run.endpoints.values() if one.node in run.nodes)

    def _remove_run(self, run: _Run, reason: str) -> None:
        """Remove a run; another present run of the bus takes its place."""
        if not run.is_told:
            return
        run.is_told = False
        del self._heard[run.bus]
        self._far.bus_removed(run.bus, reason)
        others = [one for one in self._runs.values() if one.bus == run.bus and one.token and not one.refusal]
        if others:
            self._add_run(max(others, key=lambda one: one.began))

    def _announce_node(self, run: _Run, node: FarNode) -> None:
        self._far.node_added(node)
        self._announce_endpoints(one for one in run.endpoints.values() if one.node == node.key)

    def _announce_endpoints(self, endpoints: Iterable[FarEndpoint]) -> None:
        """Report subscriptions before publishers, because an endpoint that answers needs its subscription
        first."""
        for endpoint in sorted(endpoints, key=lambda one: one.kind == "publisher"):
            self._far.endpoint_added(endpoint)


def _checked(token: Token) -> Token:
    """The same token, or Broken if the bridge would refuse its bus for it: a stranger may have written it."""
    match token:
        case NodeToken(bus, run, node) if wrong := wrong_node(node):
            return Broken(bus, run, wrong)
        case EndpointToken(bus, run, endpoint) if wrong := wrong_endpoint(endpoint):
            return Broken(bus, run, wrong)
    return token
