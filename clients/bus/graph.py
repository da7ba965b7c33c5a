"""The graph as a client sees it: nodes, endpoints, matches, with look-ups by name. Values only."""

from collections.abc import Iterable
from functools import cached_property

import msgspec

from bus.errors import RemoteProtocolError
from bus.names import join_node_name, reply_topic, request_topic, service_of_topic
from bus.qos import QoSProfile
from bus.wire import messages as m

EndpointStatistics = m.EndpointStatistics


class GraphNode(msgspec.Struct, frozen=True):
    """A node of some process."""

    id: int
    name: str
    namespace: str
    pid: int

    @property
    def full_name(self) -> str:
        return join_node_name(self.namespace, self.name)


class GraphEndpoint(msgspec.Struct, frozen=True):
    """A publisher or a subscription, as `kind` tells; `statistics` only where they were asked for."""

    id: int
    kind: str
    node: GraphNode
    topic: str
    type_name: str
    type_hash: str
    gid: bytes
    qos: QoSProfile
    statistics: EndpointStatistics | None = None


class GraphMatch(msgspec.Struct, frozen=True):
    """A publisher and a subscription between which messages flow, and the route they take."""

    publisher: int
    subscription: int
    route: str


class Graph(msgspec.Struct, frozen=True, dict=True):
    """Everything that the broker knew at one moment."""

    revision: int
    broker_pid: int
    nodes: tuple[GraphNode, ...]
    publishers: tuple[GraphEndpoint, ...]
    subscriptions: tuple[GraphEndpoint, ...]
    matches: tuple[GraphMatch, ...]

    def topics(self) -> dict[str, list[str]]:
        """Each topic with the names of its types (more than one is a conflict), sorted."""
        found: dict[str, set[str]] = {}
        for endpoint in (*self.publishers, *self.subscriptions):
            found.setdefault(endpoint.topic, set()).add(endpoint.type_name)
        return {topic: sorted(found[topic]) for topic in sorted(found)}

    def publishers_of(self, topic: str) -> list[GraphEndpoint]:
        return list(self._publishers_by_topic.get(topic, ()))

    def subscriptions_of(self, topic: str) -> list[GraphEndpoint]:
        return list(self._subscriptions_by_topic.get(topic, ()))

    def services(self) -> dict[str, list[str]]:
        """Each service that is served or called, with the names of its types, sorted."""
        return services_of((*self.publishers, *self.subscriptions))

    def servers_of(self, service: str) -> list[GraphEndpoint]:
        """What takes the service's requests, one of each server; who only looks on does not answer."""
        answering = {endpoint.node.id for endpoint in self.publishers_of(reply_topic(service))}
        return [one for one in self.subscriptions_of(request_topic(service)) if one.node.id in answering]

    def clients_of(self, service: str) -> list[GraphEndpoint]:
        """What sends it requests, one of each client."""
        return self.publishers_of(request_topic(service))

    # Who asks for one topic mostly asks for all of them.

    @cached_property
    def _publishers_by_topic(self) -> dict[str, list[GraphEndpoint]]:
        return _by_topic(self.publishers)

    @cached_property
    def _subscriptions_by_topic(self) -> dict[str, list[GraphEndpoint]]:
        return _by_topic(self.subscriptions)


def graph_of(snapshot: m.Graph) -> Graph:
    """The broker's answer as a graph. Raises RemoteProtocolError where that contradicts itself."""
    nodes = {
        node.id: GraphNode(id=node.id, name=node.name, namespace=node.namespace, pid=node.pid)
        for node in snapshot.nodes
    }
    if strange := {one.node for one in snapshot.endpoints} - nodes.keys():
        raise RemoteProtocolError(f"busd's graph has endpoints of node {min(strange)}, which is not in it")
    endpoints = [
        GraphEndpoint(
            id=one.id,
            kind=one.kind,
            node=nodes[one.node],
            topic=one.topic,
            type_name=one.type_name,
            type_hash=one.type_hash,
            gid=one.gid,
            qos=one.qos,
            statistics=one.statistics,
        )
        for one in snapshot.endpoints
    ]
    return Graph(
        revision=snapshot.revision,
        broker_pid=snapshot.pid,
        nodes=tuple(nodes.values()),
        publishers=tuple(one for one in endpoints if one.kind == "publisher"),
        subscriptions=tuple(one for one in endpoints if one.kind == "subscription"),
        matches=tuple(
            GraphMatch(publisher=match.publisher, subscription=match.subscription, route=match.route)
            for match in snapshot.matches
        ),
    )


def services_of(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[str]]:
    """The services whose requests `endpoints` carry, with the names of their types; all sorted."""
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        service = service_of_topic(endpoint.topic)
        if service is not None and endpoint.topic == request_topic(service):
            found.setdefault(service, set()).add(endpoint.type_name.removesuffix("_Request"))
    return {service: sorted(found[service]) for service in sorted(found)}


def _by_topic(endpoints: Iterable[GraphEndpoint]) -> dict[str, list[GraphEndpoint]]:
    found: dict[str, list[GraphEndpoint]] = {}
    for endpoint in endpoints:
        found.setdefault(endpoint.topic, []).append(endpoint)
    return found
