"""An endpoint in the graph, as returned by `get_publishers_info_by_topic`. Values only."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from bus.errors import ConfigurationError
from bus.graph import GraphEndpoint
from bus.qos import CHOICES, DURATIONS, info_lines
from bus_ros.rclpy.qos import QoSProfile, from_native, qos_profile_unknown
from bus_ros.rclpy.type_hash import TypeHash

__all__ = ["EndpointTypeEnum", "ServiceEndpointInfo", "TopicEndpointInfo", "TopicEndpointTypeEnum"]


class EndpointTypeEnum(IntEnum):
    """Kinds of endpoints; numbers are rmw's."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2
    CLIENT = 3
    SERVER = 4


TopicEndpointTypeEnum = EndpointTypeEnum


class TopicEndpointInfo:
    """One publisher or subscription; its str() is the block that `topic info -v` prints."""

    __slots__ = (
        "endpoint_gid",
        "endpoint_type",
        "node_name",
        "node_namespace",
        "qos_profile",
        "topic_type",
        "topic_type_hash",
    )

    def __init__(
        self,
        node_name: str = "",
        node_namespace: str = "",
        topic_type: str = "",
        topic_type_hash: TypeHash | None = None,
        endpoint_type: EndpointTypeEnum | int = EndpointTypeEnum.INVALID,
        endpoint_gid: list[int] | None = None,
        qos_profile: QoSProfile = qos_profile_unknown,
    ) -> None:
        self.node_name = node_name
        self.node_namespace = node_namespace
        self.topic_type = topic_type
        self.topic_type_hash = TypeHash() if topic_type_hash is None else topic_type_hash
        self.endpoint_type = EndpointTypeEnum(endpoint_type)
        self.endpoint_gid = [] if endpoint_gid is None else endpoint_gid
        self.qos_profile = qos_profile

    @classmethod
    def from_graph(cls, endpoint: GraphEndpoint) -> "TopicEndpointInfo":
        """From an endpoint in the bus's graph."""
        return cls(
            node_name=endpoint.node.name,
            node_namespace=endpoint.node.namespace,
            topic_type=endpoint.type_name,
            topic_type_hash=TypeHash.parse(endpoint.type_hash),
            endpoint_type=EndpointTypeEnum[endpoint.kind.upper()],
            endpoint_gid=list(endpoint.gid),
            qos_profile=from_native(endpoint.qos),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TopicEndpointInfo):
            return False
        return all(getattr(self, slot) == getattr(other, slot) for slot in self.__slots__)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        qos = self.qos_profile
        texts = {one.name: getattr(qos, one.name).name for one in CHOICES}
        texts |= {one.name: str(getattr(qos, one.name)) for one in DURATIONS}
        return "\n".join(
            [
                f"Node name: {self.node_name}",
                f"Node namespace: {self.node_namespace}",
                f"Topic type: {self.topic_type}",
                f"Topic type hash: {self.topic_type_hash}",
                f"Endpoint type: {self.endpoint_type.name}",
                f"GID: {'.'.join(f'{part:02x}' for part in self.endpoint_gid)}",
                *info_lines(texts, qos.depth),
            ]
        )


class ServiceEndpointInfo(NamedTuple):
    """A client or a server, which sends by one endpoint and receives by another: `endpoint_count` is 2."""

    node_name: str
    node_namespace: str
    service_type: str
    service_type_hash: TypeHash
    endpoint_type: EndpointTypeEnum
    endpoint_count: int
    endpoint_gids: list[list[int]]
    qos_profiles: list[QoSProfile]

    @classmethod
    def of_ends(cls, kind: EndpointTypeEnum, ends: Sequence[GraphEndpoint]) -> "ServiceEndpointInfo":
        """From the endpoints of its requests and answers in the bus's graph."""
        request = ends[0]
        service_type = request.type_name.removesuffix("_Request")
        return cls(
            node_name=request.node.name,
            node_namespace=request.node.namespace,
            service_type=service_type,
            service_type_hash=_hash_of_service(service_type),
            endpoint_type=kind,
            endpoint_count=len(ends),
            endpoint_gids=[list(one.gid) for one in ends],
            qos_profiles=[from_native(one.qos) for one in ends],
        )


def _hash_of_service(service_type: str) -> TypeHash:
    from bus_ros.rosidl.description import service_hash  # late: few programs ask

    try:
        return TypeHash.parse(service_hash(service_type))
    except ConfigurationError:  # the program has its own definition
        return TypeHash()
