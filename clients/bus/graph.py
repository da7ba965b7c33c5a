"""The graph for clients: nodes, endpoints, matches, with look-ups by name. Only values."""

from collections.abc import Iterable, Mapping
from functools import cached_property

import msgspec

from bus.errors import RemoteProtocolError
from bus.names import join_node_name, reply_topic, request_topic, service_of_topic
from bus.qos import QoSProfile
from bus.wire import messages as m

EndpointStatistics = m.EndpointStatistics
Origin = m.Origin


class GraphNode(msgspec.Struct, frozen=True):
    """A node of some process.

    For example:

        print([(one.full_name, one.pid) for one in (await node.graph()).nodes])
    """

    id: int
    """busd's number for it."""
    name: str
    """Without the namespace."""
    namespace: str
    """Starts with a slash; `/` for none."""
    pid: int
    """Its process; the bridge's process if it has an `origin`."""
    origin: Origin | None = None
    """The bus from which a bridge mirrors it; None if it is on this bus."""

    @property
    def full_name(self) -> str:
        """Namespace and name."""
        return join_node_name(self.namespace, self.name)


class GraphEndpoint(msgspec.Struct, frozen=True):
    """A publisher or a subscription of some node.

    For example:

        print([one.node.name for one in (await node.graph()).publishers_of("/chatter")])
    """

    id: int
    """busd's number for it."""
    kind: str
    """`publisher`, `subscription`, or `tap`: a bridge's subscription that represents others."""
    node: GraphNode
    """The node that made it."""
    topic: str
    """The topic's full name."""
    type_name: str
    """The message's type, as `std_msgs/msg/String`."""
    type_hash: str
    """Hash of the type's description: two types match if name and hash are equal."""
    gid: bytes
    """16 bytes that no other endpoint has."""
    qos: QoSProfile
    """Its policies."""
    statistics: EndpointStatistics | None = None
    """Its counters, if they were requested."""


class GraphMatch(msgspec.Struct, frozen=True):
    """A publisher and a subscription between which messages flow, and the route they take.

    For example:

        print([one.route for one in (await node.graph()).matches])
    """

    publisher: int
    """The publisher's `id` in the graph."""
    subscription: int
    """The subscription's `id` in the graph."""
    route: str
    """`shm` or `socket`; `bridge` if the subscription is on another bus."""


class Graph(msgspec.Struct, frozen=True, dict=True):
    """A snapshot of busd's nodes, endpoints and matches, as far as its rules let this user see them.

    For example:

        print((await node.graph()).topics())
    """

    revision: int
    """One more with every change."""
    broker_pid: int
    """busd's process id."""
    nodes: tuple[GraphNode, ...]
    """All nodes."""
    publishers: tuple[GraphEndpoint, ...]
    """All publishers, including publishers of services and of /rosout."""
    subscriptions: tuple[GraphEndpoint, ...]
    """All subscriptions, including subscriptions of services."""
    matches: tuple[GraphMatch, ...]
    """All matches, including matches of taps."""
    taps: tuple[GraphEndpoint, ...] = ()
    """Bridges' endpoints that take messages for subscriptions on other buses. `subscriptions` does not
    include them, nor does any count."""

    def topics(self) -> dict[str, list[str]]:
        """Each topic with the names of its types (more than one is a conflict), sorted."""
        found: dict[str, set[str]] = {}
        for endpoint in (*self.publishers, *self.subscriptions):
            found.setdefault(endpoint.topic, set()).add(endpoint.type_name)
        return {topic: sorted(found[topic]) for topic in sorted(found)}

    def publishers_of(self, topic: str) -> list[GraphEndpoint]:
        """The publishers on `topic`, a full name; may be empty."""
        return list(self._publishers_by_topic.get(topic, ()))

    def subscriptions_of(self, topic: str) -> list[GraphEndpoint]:
        """The subscriptions to `topic`, a full name; may be empty."""
        return list(self._subscriptions_by_topic.get(topic, ()))

    def services(self) -> dict[str, list[str]]:
        """Each service that is served or called, with the names of its types, sorted."""
        return services_of((*self.publishers, *self.subscriptions))

    def servers_of(self, service: str) -> list[GraphEndpoint]:
        """The subscriptions to the service's requests, one of each server, without observers'
        subscriptions."""
        answering = {endpoint.node.id for endpoint in self.publishers_of(reply_topic(service))}
        return [one for one in self.subscriptions_of(request_topic(service)) if one.node.id in answering]

    def clients_of(self, service: str) -> list[GraphEndpoint]:
        """The publishers of the service's requests, one of each client."""
        return self.publishers_of(request_topic(service))

    # A caller that requests one topic usually requests all of them.

    @cached_property
    def _publishers_by_topic(self) -> dict[str, list[GraphEndpoint]]:
        return _by_topic(self.publishers)

    @cached_property
    def _subscriptions_by_topic(self) -> dict[str, list[GraphEndpoint]]:
        return _by_topic(self.subscriptions)


def graph_of(snapshot: m.GraphSnapshot) -> Graph:
    """The broker's answer as a graph. Raises RemoteProtocolError if the answer contradicts itself."""
    nodes = {node.id: node_of(node) for node in snapshot.nodes}
    if strange := {one.node for one in snapshot.endpoints} - nodes.keys():
        raise RemoteProtocolError(f"busd's graph has endpoints of node {min(strange)}, which is not in it")
    endpoints = [endpoint_of(one, nodes) for one in snapshot.endpoints]
    return Graph(
        revision=snapshot.revision,
        broker_pid=snapshot.pid,
        nodes=tuple(nodes.values()),
        publishers=tuple(one for one in endpoints if one.kind == "publisher"),
        subscriptions=tuple(one for one in endpoints if one.kind == "subscription"),
        taps=tuple(one for one in endpoints if one.kind == "tap"),
        matches=tuple(map(match_of, snapshot.matches)),
    )


def node_of(record: m.NodeRecord) -> GraphNode:
    return GraphNode(
        id=record.id, name=record.name, namespace=record.namespace, pid=record.pid, origin=record.origin
    )


def endpoint_of(record: m.EndpointRecord, nodes: Mapping[int, GraphNode]) -> GraphEndpoint:
    return GraphEndpoint(
        id=record.id,
        kind=record.kind,
        node=nodes[record.node],
        topic=record.topic,
        type_name=record.type_name,
        type_hash=record.type_hash,
        gid=record.gid,
        qos=record.qos,
        statistics=record.statistics,
    )


def match_of(record: m.MatchRecord) -> GraphMatch:
    return GraphMatch(publisher=record.publisher, subscription=record.subscription, route=record.route)


def services_of(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[str]]:
    """The services of the request topics among `endpoints`, with the names of their types; all sorted."""
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        service = service_of_topic(endpoint.topic)
        if service is not None and endpoint.topic == request_topic(service):
            found.setdefault(service, set()).add(endpoint.type_name.removesuffix("_Request"))
    return {service: sorted(found[service]) for service in sorted(found)}


def types_of(graph: Graph, topic: str, type_name: str | None) -> list[tuple[str, str]]:
    """The possible types, each once: types of the topic, or else types of that name."""
    endpoints = (*graph.publishers_of(topic), *graph.subscriptions_of(topic))
    here = {(one.type_name, one.type_hash) for one in endpoints}
    if type_name is not None:
        here = {kind for kind in here if kind[0] == type_name}
        everywhere = (*graph.publishers, *graph.subscriptions)
        here = here or {(one.type_name, one.type_hash) for one in everywhere if one.type_name == type_name}
    return sorted(here)


def _by_topic(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[GraphEndpoint]]:
    found: dict[str, list[GraphEndpoint]] = {}
    for endpoint in endpoints:
        found.setdefault(endpoint.topic, []).append(endpoint)
    return found
