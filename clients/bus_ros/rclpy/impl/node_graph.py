"""A node's place in the graph: its name, the names of its endpoints, and its view of other nodes."""

from collections.abc import Callable, Iterable

from bus import names
from bus.errors import ConfigurationError
from bus.graph import Graph, GraphEndpoint, services_of
from bus.names import reply_topic, service_of_topic
from bus.node import Node as NativeNode
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import NodeNameNonExistentError, RCLError, rule_of
from bus_ros.rclpy.topic_endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from bus_ros.rclpy.validate_topic_name import full_name

__all__ = ["NodeGraph"]

NamesAndTypes = list[tuple[str, list[str]]]


class NodeGraph:
    """Base of BaseNode. Its private names are mangled: a program's nodes may use the same names.

    `read_graph` returns the current graph.
    """

    def __init__(self, native: NativeNode, handle: Handle, read_graph: Callable[[], Graph]) -> None:
        self.__native = native
        self.__handle = handle
        self.__read_graph = read_graph

    @property
    def handle(self) -> Handle:
        """The handle for programs that use rclpy's handles: `with node.handle:`."""
        return self.__handle

    def get_name(self) -> str:
        return self.__native.name

    def get_namespace(self) -> str:
        return self.__native.namespace

    def get_fully_qualified_name(self) -> str:
        return self.__native.full_name

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """The full name; after remapping, unless `only_expand`.

        Raises RCLError for an invalid name.
        """
        return self.__resolve(topic, self.__native.resolve_topic_name, only_expand)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """As `resolve_topic_name`."""
        return self.__resolve(service, self.__native.resolve_service_name, only_expand)

    # --- the content of the graph; lists are sorted by name

    def get_topic_names_and_types(self, no_demangle: bool = False) -> NamesAndTypes:
        """All topics; with `no_demangle` also topics of services."""
        graph = self.__graph()
        return _names_and_types((*graph.publishers, *graph.subscriptions), no_demangle)

    def get_service_names_and_types(self) -> NamesAndTypes:
        return list(self.__graph().services().items())

    def get_node_names(self) -> list[str]:
        return [node.name for node in self.__graph().nodes]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(node.name, node.namespace) for node in self.__graph().nodes]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        return [(node.name, node.namespace, "/") for node in self.__graph().nodes]

    def get_fully_qualified_node_names(self) -> list[str]:
        return [node.full_name for node in self.__graph().nodes]

    def count_publishers(self, topic_name: str) -> int:
        return len(self.__graph().publishers_of(self.__topic(topic_name)))

    def count_subscribers(self, topic_name: str) -> int:
        return len(self.__graph().subscriptions_of(self.__topic(topic_name)))

    def count_services(self, service_name: str) -> int:
        return len(self.__graph().servers_of(self.__service(service_name)))

    def count_clients(self, service_name: str) -> int:
        return len(self.__graph().clients_of(self.__service(service_name)))

    def get_publishers_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        found = self.__graph().publishers_of(self.__topic(topic_name))
        return [TopicEndpointInfo.from_graph(one) for one in found]

    def get_subscriptions_info_by_topic(
        self, topic_name: str, no_mangle: bool = False
    ) -> list[TopicEndpointInfo]:
        found = self.__graph().subscriptions_of(self.__topic(topic_name))
        return [TopicEndpointInfo.from_graph(one) for one in found]

    def get_servers_info_by_service(
        self, service_name: str, no_mangle: bool = False
    ) -> list[ServiceEndpointInfo]:
        """The servers of a service."""
        graph, service = self.__graph(), self.__service(service_name)
        return _service_infos(
            EndpointTypeEnum.SERVER, graph.servers_of(service), graph.publishers_of(reply_topic(service))
        )

    def get_clients_info_by_service(
        self, service_name: str, no_mangle: bool = False
    ) -> list[ServiceEndpointInfo]:
        """The clients of a service."""
        graph, service = self.__graph(), self.__service(service_name)
        return _service_infos(
            EndpointTypeEnum.CLIENT, graph.clients_of(service), graph.subscriptions_of(reply_topic(service))
        )

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        """The publishers of a node; as all of these, raises NodeNameNonExistentError."""
        graph = self.__graph()
        return _names_and_types(_of_node(graph, graph.publishers, node_name, node_namespace), no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> NamesAndTypes:
        graph = self.__graph()
        return _names_and_types(_of_node(graph, graph.subscriptions, node_name, node_namespace), no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        graph = self.__graph()
        return list(services_of(_of_node(graph, graph.subscriptions, node_name, node_namespace)).items())

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        graph = self.__graph()
        return list(services_of(_of_node(graph, graph.publishers, node_name, node_namespace)).items())

    # --- actions, found in topics as rcl_action does

    def get_action_names_and_types(self) -> NamesAndTypes:
        """All actions that have a server or a client."""
        return _actions(self.get_topic_names_and_types(no_demangle=True))

    def get_action_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """The actions that a node calls. Raises NodeNameNonExistentError."""
        topics = self.get_subscriber_names_and_types_by_node(node_name, node_namespace, no_demangle=True)
        return _actions(topics)

    def get_action_server_names_and_types_by_node(self, node_name: str, node_namespace: str) -> NamesAndTypes:
        """The actions that a node serves. Raises NodeNameNonExistentError."""
        topics = self.get_publisher_names_and_types_by_node(node_name, node_namespace, no_demangle=True)
        return _actions(topics)

    # --- inside

    def __resolve(self, name: str, resolve: Callable[[str], str], only_expand: bool) -> str:
        try:
            if only_expand:
                return names.expand_topic_name(name, self.__native.name, self.__native.namespace)
            return resolve(name)
        except ConfigurationError as error:
            raise RCLError(f"failed to resolve name: {rule_of(error)}") from None

    def __topic(self, name: str) -> str:
        return full_name(_text(name), self.__native.resolve_topic_name)

    def __service(self, name: str) -> str:
        return full_name(_text(name), self.__native.resolve_service_name, is_service=True)

    def __graph(self) -> Graph:
        self.__handle.check()
        return self.__read_graph()


def _of_node(
    graph: Graph, endpoints: Iterable[GraphEndpoint], name: str, namespace: str
) -> list[GraphEndpoint]:
    wanted = f"{namespace.rstrip('/')}/{name}"
    if not any(node.full_name == wanted for node in graph.nodes):
        raise NodeNameNonExistentError(f"Cannot get the names and types of nonexistent node: {wanted}")
    return [one for one in endpoints if one.node.full_name == wanted]


def _service_infos(
    kind: EndpointTypeEnum, requests: Iterable[GraphEndpoint], replies: Iterable[GraphEndpoint]
) -> list[ServiceEndpointInfo]:
    """Pair each endpoint of requests with the next endpoint of answers of its node."""
    left = list(replies)
    found = []
    for request in requests:
        reply = next((one for one in left if one.node.id == request.node.id), None)
        if reply is not None:
            left.remove(reply)
        found.append(ServiceEndpointInfo.of_ends(kind, [request, *([reply] if reply else ())]))
    return found


def _names_and_types(endpoints: Iterable[GraphEndpoint], with_services: bool) -> NamesAndTypes:
    found: dict[str, set[str]] = {}
    for endpoint in endpoints:
        if with_services or service_of_topic(endpoint.topic) is None:
            found.setdefault(endpoint.topic, set()).add(endpoint.type_name)
    return [(topic, sorted(found[topic])) for topic in sorted(found)]


def _actions(topics: NamesAndTypes) -> NamesAndTypes:
    from bus_actions.graph import actions_of_topics  # late: few programs ask

    found = actions_of_topics((topic, type_name) for topic, types in topics for type_name in types)
    return list(found.items())


def _text(name: str) -> str:
    if not isinstance(name, str):
        raise TypeError(f"a name must be a str, not {type(name).__name__}")
    return name
