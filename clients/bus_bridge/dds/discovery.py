"""Converts DDS discovery to news of far nodes and endpoints.

Owns: which endpoints are far (neither ours nor another busd's), and their descriptions on the bus. Must not
know: the carrier that finds them.
"""

import asyncio
import time
from collections.abc import Callable, Mapping

from bus.errors import ConfigurationError
from bus.names import (
    reply_topic,
    request_topic,
    validate_full_topic_name,
)
from bus.qos import Durability, QoSProfile, Reliability
from bus.schema import MessageSchema
from bus.types.service import keeping_all
from bus_bridge.dds import qos
from bus_bridge.dds.carrier import Discovered, NodeTopic
from bus_bridge.dds.client_pairs import ClientPairs
from bus_bridge.dds.graph import (
    Added,
    DomainGraph,
    Found,
    News,
    NodeEntities,
    Removed,
    announcer_of,
    participant_of,
)
from bus_bridge.dds.names import (
    ENCLAVE,
    MARK,
    kind_of,
    service_part_from_dds,
    topic_from_dds,
)
from bus_bridge.engine import FarEndpoint, FarNode, FarSide
from bus_bridge.errors import BridgeError
from bus_bridge.ros2.calls import OF_SERVICES
from bus_bridge.ros2.known_types import MOST_UNKNOWN, TOO_MANY_UNKNOWN, KnownTypes
from bus_bridge.ros2.node_names import is_right_node
from bus_bridge.ros2.service_types import KnownServices
from bus_bridge.ros2.type_names import type_from_dds

__all__ = ["Discovery"]


class Discovery:
    """The results of discovery: the Listener of a carrier.

    `on_change` is called after each piece of news, for code that uses handles.
    """

    def __init__(
        self,
        graph: DomainGraph,
        types: KnownTypes,
        services: KnownServices,
        far: FarSide,
        on_change: Callable[[], None],
    ) -> None:
        self._graph = graph
        self._types = types
        self._services = services
        self._far = far
        self._on_change = on_change
        self._loop = asyncio.get_running_loop()
        self._is_closed = False
        self._timer: asyncio.TimerHandle | None = None
        self.handles: dict[bytes, int] = {}
        """Handles of the far endpoints that are mirrored, by gid."""
        self.gids: dict[int, bytes] = {}
        """Gids of all far endpoints that belong to no busd, by handle."""
        self.marked: set[int] = set()
        """Handles of unread endpoints: they belong to other busds or to refused participants."""
        self.refused: dict[str, bytes] = {}
        """Participants that are refused as long as they exist, by their announcer."""
        self.publishers: dict[str, dict[bytes, qos.ReaderKind]] = {}
        """Far publishers by topic and gid."""
        self._unknown: dict[bytes, Discovered] = {}
        """Endpoints of unknown types, by gid: their types may become known."""
        self.node_topic: NodeTopic | None = None
        self._topics: dict[bytes, str] = {}
        self._client_pairs = ClientPairs()

    def close(self) -> None:
        """Stop reporting news."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()

    def nodes_said(self, participant: bytes, nodes: list[NodeEntities]) -> None:
        """Handle a participant's list of its own nodes."""
        if announcer_of(participant) in self.refused:
            return
        right = [node for node in nodes if is_right_node(node.namespace, node.name, self._far.warn)]
        self._report(self._graph.nodes_said(participant, right))

    def refuse(self, announcer: str) -> None:
        """Refuse a participant. May be called while its news are reported."""
        if announcer not in self.refused:
            self.refused[announcer] = participant_of(announcer)
            self._loop.call_soon(self._ignore, self.refused[announcer])

    def _ignore(self, participant: bytes) -> None:
        for gid in self._graph.endpoints_of(participant):
            if (handle := self.handles.get(gid)) is not None:
                self.endpoint_removed(gid, handle)
                self.marked.add(handle)
        self._report(self._graph.participant_removed(participant))
        self._on_change()

    def types_changed(self) -> None:
        """Try endpoints of unknown types again, because a type has become known."""
        if self._unknown:
            unknown, self._unknown = self._unknown, {}
            for found in unknown.values():
                self.endpoint_added(found)

    # --- news of the carrier

    def participant_added(self, participant: bytes, user_data: Mapping[str, str]) -> None:
        self._graph.participant_added(participant, speaks_ros=ENCLAVE in user_data)

    def participant_removed(self, participant: bytes) -> None:
        self.refused.pop(announcer_of(participant), None)
        self._report(self._graph.participant_removed(participant))

    def changed(self) -> None:
        self._on_change()

    def endpoint_added(self, found: Discovered) -> None:
        handle, gid = found.handle, found.gid
        if MARK in found.user_data or announcer_of(found.participant) in self.refused:
            self.marked.add(handle)
            if self.node_topic is not None and kind_of(found.topic) == "graph":
                self.node_topic.ignore(handle)
            return
        self.gids[handle] = gid
        match kind_of(found.topic):
            case "graph" if found.kind == "publisher" and self.node_topic is not None:
                self.node_topic.writer_added(handle, found.participant, "typehash" not in found.user_data)
            case "service":
                for one in self._service_endpoints(found):
                    self._report(self._graph.endpoint_added(one, time.monotonic()))
            case "topic":
                of_topic = self._topic_endpoint(found)
                if of_topic is not None:
                    self.handles[gid] = handle
                    if found.kind == "publisher":
                        topic, offered = of_topic.endpoint.topic, of_topic.endpoint.qos
                        self.publishers.setdefault(topic, {})[gid] = qos.ReaderKind(
                            offered.durability is Durability.TRANSIENT_LOCAL,
                            offered.reliability is Reliability.RELIABLE,
                        )
                        self._topics[gid] = topic
                    self._report(self._graph.endpoint_added(of_topic, time.monotonic()))

    def endpoint_removed(self, gid: bytes, handle: int) -> None:
        self.gids.pop(handle, None)
        self.handles.pop(gid, None)
        self._unknown.pop(gid, None)
        self._client_pairs.removed(gid)
        self.marked.discard(handle)
        if (topic := self._topics.pop(gid, None)) is not None:
            del self.publishers[topic][gid]
            if not self.publishers[topic]:
                del self.publishers[topic]
        if self.node_topic is not None:
            self.node_topic.writer_removed(handle)
        self._report(self._graph.endpoint_removed(gid))

    def is_marked(self, handle: int) -> bool:
        return handle in self.marked

    def is_mirrored(self, gid: bytes) -> bool:
        return gid in self.handles

    def is_far(self, handle: int) -> bool:
        return handle in self.gids

    # --- inside

    def _topic_endpoint(self, found: Discovered) -> Found | None:
        topic, type_name = topic_from_dds(found.topic), type_from_dds(found.type_name)
        if topic is None:
            return None
        if type_name is None:
            self._far.warn(f"topic {topic} of ROS 2 is left out: {found.type_name!r} is not a type of ROS 2")
            return None
        try:
            validate_full_topic_name(topic)
            schema = self._types.find(type_name, found.user_data.get("typehash", "")).schema
            profile = qos.profile_of(found.policies)
        except BridgeError as error:
            self._unknown_type(found)
            self._far.warn(f"topic {topic} of ROS 2 is left out: {error}")
            return None
        except ConfigurationError as error:
            self._far.warn(f"topic {topic} of ROS 2 is left out: {str(error).splitlines()[0]}")
            return None
        return _found(found, topic, schema, profile)

    def _service_endpoints(self, found: Discovered) -> list[Found]:
        """The endpoints to report after an endpoint of a server or client was found. Their messages use
        RTPS."""
        part = service_part_from_dds(found.topic, found.type_name)
        if part is None:
            self._far.warn(
                f"'{found.topic:.300}' of ROS 2 is left out: {found.type_name!r:.300} is not its type"
            )
            return []
        topic = request_topic(part.service) if part.is_request else reply_topic(part.service)
        try:
            validate_full_topic_name(topic)
            types = self._services.find(part.type_name)
        except BridgeError as error:
            self._unknown_type(found)
            self._far.warn(f"service {part.service} of ROS 2 is left out: {error}")
            return []
        except ConfigurationError as error:
            reason = str(error).splitlines()[0]
            self._far.warn(f"service {part.service} of ROS 2 is left out: {reason}")
            return []
        schema = types.requests if part.is_request else types.replies
        profile = OF_SERVICES if found.kind == "publisher" else keeping_all(OF_SERVICES)
        one = _found(found, topic, schema, profile)
        is_of_client = part.is_request is (found.kind == "publisher")
        return self._client_pairs.added(one, part.service) if is_of_client else [one]

    def _unknown_type(self, found: Discovered) -> None:
        """Keep an endpoint whose type is not known: it may become known."""
        if found.gid in self._unknown or len(self._unknown) < MOST_UNKNOWN:
            self._unknown[found.gid] = found
        else:
            self._far.warn(TOO_MANY_UNKNOWN)

    def _report(self, news: News) -> None:
        for piece in news:
            match piece:
                case Added(FarNode() as node):
                    if node.announcer not in self.refused:
                        self._far.node_added(node)
                case Added(FarEndpoint() as endpoint):
                    self._far.endpoint_added(endpoint)
                case Removed(node, gid) if gid:
                    self._far.endpoint_removed(gid, node)
                case Removed(node):
                    self._far.node_removed(node)
        if self._timer is not None or self._is_closed:
            return  # without a look at all waiting endpoints
        if (end := self._graph.next_time) is not None:
            self._timer = self._loop.call_later(max(end - time.monotonic(), 0.01), self._pass_time)

    def _pass_time(self) -> None:
        self._timer = None
        self._report(self._graph.pass_time(time.monotonic()))


def _found(found: Discovered, topic: str, schema: MessageSchema, profile: QoSProfile) -> Found:
    endpoint = FarEndpoint(found.kind, found.gid, "", topic, schema.type_name, schema.type_hash, profile)
    return Found(found.participant, endpoint)
