"""What a node of the facade tells of the graph: names, types and counts, from a snapshot of the broker's."""

from collections.abc import Iterable
from typing import Any

from bus.graph import Graph, GraphEndpoint, services_of
from bus.names import service_of_topic
from bus_ros.rclpy.exceptions import NodeNameNonExistentError
from bus_ros.rclpy.topic_endpoint_info import TopicEndpointInfo

__all__ = ["GraphQueries"]

NamesAndTypes = list[tuple[str, list[str]]]


class GraphQueries:
    """Base of Node. Lists are sorted by name; names are remapped as the node's own."""

    def _graph(self) -> Graph:
        raise NotImplementedError

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        raise NotImplementedError

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        raise NotImplementedError

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """All topics; with `no_demangle` also those that carry services."""
        graph = self._graph()
        return _names_and_types((*graph.publishers, *graph.subscriptions), no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        return list(self._graph().services().items())

    def get_node_names(self) -> list[str]:
        return [node.name for node in self._graph().nodes]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(node.name, node.namespace) for node in self._graph().nodes]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        return [(node.name, node.namespace, "/") for node in self._graph().nodes]

    def get_fully_qualified_node_names(self) -> list[str]:
        return [node.full_name for node in self._graph().nodes]

    def count_publishers(self, topic_name: str) -> int:
        return len(self._graph().publishers_of(self.resolve_topic_name(topic_name)))

    def count_subscribers(self, topic_name: str) -> int:
        return len(self._graph().subscriptions_of(self.resolve_topic_name(topic_name)))

    def count_services(self, service_name: str) -> int:
        return len(self._graph().servers_of(self.resolve_service_name(service_name)))

    def count_clients(self, service_name: str) -> int:
        return len(self._graph().clients_of(self.resolve_service_name(service_name)))

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        found = self._graph().publishers_of(self.resolve_topic_name(topic_name))
        return [TopicEndpointInfo.from_graph(one) for one in found]

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        found = self._graph().subscriptions_of(self.resolve_topic_name(topic_name))
        return [TopicEndpointInfo.from_graph(one) for one in found]

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """Raises NodeNameNonExistentError, as all of these do."""
        graph = self._graph()
        return _names_and_types(_of_node(graph, graph.publishers, node_name, node_namespace), no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        graph = self._graph()
        return _names_and_types(_of_node(graph, graph.subscriptions, node_name, node_namespace), no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        graph = self._graph()
        return list(services_of(_of_node(graph, graph.subscriptions, node_name, node_namespace)).items())

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        graph = self._graph()
        return list(services_of(_of_node(graph, graph.publishers, node_name, node_namespace)).items())


def _of_node(
    graph: Graph, endpoints: Iterable[GraphEndpoint], name: str, namespace: str
) -> list[GraphEndpoint]:
    wanted = f"{namespace.rstrip('/')}/{name}"
    if not any(node.full_name == wanted for node in graph.nodes):
        raise NodeNameNonExistentError(f"Cannot get the names and types of nonexistent node: {wanted}")
    return [one for one in endpoints if one.node.full_name == wanted]


def _names_and_types(endpoints: Iterable[Any], with_services: bool) -> NamesAndTypes:
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        if with_services or service_of_topic(endpoint.topic) is None:
            found.setdefault(endpoint.topic, set()).add(endpoint.type_name)
    return [(topic, sorted(found[topic])) for topic in sorted(found)]
