"""Converts DDS discovery to news of far nodes and endpoints.

Owns: cyclonedds' built-in readers and their data, and the decision which endpoints are far: neither ours nor
another busd's.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any, Final

from bus.errors import ConfigurationError
from bus.names import (
    reply_topic,
    request_topic,
    validate_full_topic_name,
    validate_namespace,
    validate_node_name,
)
from bus.qos import Durability, Reliability
from bus.types.service import keeping_all
from bus_bridge.dds import qos
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
from bus_bridge.dds.known_types import KnownTypes
from bus_bridge.dds.names import (
    ENCLAVE,
    MARK,
    kind_of,
    service_part_from_dds,
    topic_from_dds,
    type_from_dds,
    user_data_of,
)
from bus_bridge.dds.node_info import NodeInfo
from bus_bridge.dds.participant import Participant, policies_of, user_data_in
from bus_bridge.dds.service_types import KnownServices
from bus_bridge.engine import EndpointKind, FarEndpoint, FarNode, FarSide
from bus_bridge.errors import BridgeError

__all__ = ["Discovery"]

_ALIVE: Final = 16
_BATCH: Final = 256
_MOST_UNKNOWN: Final = 1000
"""Most endpoints of unknown types that are kept, because their types may become known."""


class Discovery:
    """Discovery of one participant. It ends with the participant.

    `on_change` is called after each piece of news, for code that uses handles.
    """

    def __init__(
        self,
        participant: Participant,
        graph: DomainGraph,
        types: KnownTypes,
        services: KnownServices,
        far: FarSide,
        on_change: Callable[[], None],
    ) -> None:
        self._participant = participant
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
        self._unknown: dict[bytes, tuple[int, bytes, Any, EndpointKind]] = {}
        """Endpoints of unknown types, by gid: their types may become known."""
        self.node_info: NodeInfo | None = None
        self._topics: dict[bytes, str] = {}
        self._client_pairs = ClientPairs()
        self._scheduled: set[str] = set()
        self._readers: dict[str, Any] = {}

    def open(self, node_info: NodeInfo) -> None:
        """Start; `node_info` learns of the writers of its topic."""
        self.node_info = node_info
        for what in ("DcpsParticipant", "DcpsPublication", "DcpsSubscription"):
            self._readers[what] = self._participant.watch(what, self._waker(what))
            self._schedule(what)

    def close(self) -> None:
        """Stop reporting news."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()

    def nodes_said(self, participant: bytes, nodes: list[NodeEntities]) -> None:
        """Handle a participant's list of its own nodes."""
        if announcer_of(participant) in self.refused:
            return
        right = [node for node in nodes if self._is_right(node)]
        self._report(self._graph.nodes_said(participant, right))

    def refuse(self, announcer: str) -> None:
        """Refuse a participant. May be called while its news are reported."""
        if announcer not in self.refused:
            self.refused[announcer] = participant_of(announcer)
            self._loop.call_soon(self._ignore, self.refused[announcer])

    def _ignore(self, participant: bytes) -> None:
        for gid in self._graph.endpoints_of(participant):
            if (handle := self.handles.get(gid)) is not None:
                self._endpoint_removed(gid, handle)
                self.marked.add(handle)
        self._report(self._graph.participant_removed(participant))
        self._on_change()

    def types_changed(self) -> None:
        """Try endpoints of unknown types again, because a type has become known."""
        if self._unknown:
            unknown, self._unknown = self._unknown, {}
            for handle, participant, sample, kind in unknown.values():
                self._endpoint_added(handle, participant, sample, kind)

    def _is_right(self, node: NodeEntities) -> bool:
        try:
            validate_node_name(node.name)
            validate_namespace(node.namespace)
        except ConfigurationError as error:
            name = f"{node.namespace.rstrip('/')}/{node.name}"
            self._far.warn(f"node {name!r:.300} of ROS 2 is left out: {str(error).splitlines()[0]}")
            return False
        return True

    def _waker(self, what: str) -> Callable[[], None]:
        def wake() -> None:  # in a thread of Cyclone
            if what not in self._scheduled:
                self._scheduled.add(what)
                self._loop.call_soon_threadsafe(self._drain, what)

        return wake

    def _schedule(self, what: str) -> None:
        self._scheduled.add(what)
        self._loop.call_soon(self._drain, what)

    def _drain(self, what: str) -> None:
        self._scheduled.discard(what)
        if self._is_closed or what not in self._readers:
            return
        samples = self._readers[what].take(_BATCH)
        for sample in samples:
            is_alive = sample.sample_info.instance_state == _ALIVE
            guid = sample.key.bytes
            if what == "DcpsParticipant":
                if is_alive:
                    said = user_data_of(user_data_in(sample.qos))
                    self._graph.participant_added(guid, speaks_ros=ENCLAVE in said)
                else:
                    self.refused.pop(announcer_of(guid), None)
                    self._report(self._graph.participant_removed(guid))
            elif not is_alive:
                self._endpoint_removed(guid, sample.sample_info.instance_handle)
            elif sample.participant_key.bytes != self._participant.guid:
                kind: EndpointKind = "publisher" if what == "DcpsPublication" else "subscription"
                handle = sample.sample_info.instance_handle
                self._endpoint_added(handle, sample.participant_key.bytes, sample, kind)
        if len(samples) == _BATCH:
            self._schedule(what)
        if samples:
            self._on_change()

    def _endpoint_added(self, handle: int, participant: bytes, sample: Any, kind: EndpointKind) -> None:
        said = user_data_of(user_data_in(sample.qos))
        if MARK in said or announcer_of(participant) in self.refused:
            self.marked.add(handle)
            if self.node_info is not None and kind_of(sample.topic_name) == "graph":
                self.node_info.ignore(handle)
            return
        gid = sample.key.bytes
        self.gids[handle] = gid
        match kind_of(sample.topic_name):
            case "graph" if kind == "publisher" and self.node_info is not None:
                self.node_info.writer_added(handle, participant, "typehash" not in said)
            case "service":
                for one in self._service_endpoints(handle, participant, sample, kind):
                    self._report(self._graph.endpoint_added(one, time.monotonic()))
            case "topic":
                found = self._endpoint(handle, participant, sample, kind, said.get("typehash", ""))
                if found is not None:
                    self.handles[gid] = handle
                    if kind == "publisher":
                        topic, offered = found.endpoint.topic, found.endpoint.qos
                        self.publishers.setdefault(topic, {})[gid] = qos.ReaderKind(
                            offered.durability is Durability.TRANSIENT_LOCAL,
                            offered.reliability is Reliability.RELIABLE,
                        )
                        self._topics[gid] = topic
                    self._report(self._graph.endpoint_added(found, time.monotonic()))

    def _endpoint(
        self, handle: int, participant: bytes, sample: Any, kind: EndpointKind, type_hash: str
    ) -> Found | None:
        topic, type_name = topic_from_dds(sample.topic_name), type_from_dds(sample.type_name)
        if topic is None:
            return None
        gid = sample.key.bytes
        if type_name is None:
            self._far.warn(f"topic {topic} of ROS 2 is left out: {sample.type_name!r} is not a type of ROS 2")
            return None
        try:
            validate_full_topic_name(topic)
            schema = self._types.find(type_name, type_hash).schema
            profile = qos.profile_of(policies_of(sample.qos))
        except BridgeError as error:
            self._unknown_type(handle, participant, sample, kind)
            self._far.warn(f"topic {topic} of ROS 2 is left out: {error}")
            return None
        except ConfigurationError as error:
            self._far.warn(f"topic {topic} of ROS 2 is left out: {str(error).splitlines()[0]}")
            return None
        return Found(
            participant, FarEndpoint(kind, gid, "", topic, schema.type_name, schema.type_hash, profile)
        )

    def _service_endpoints(
        self, handle: int, participant: bytes, sample: Any, kind: EndpointKind
    ) -> list[Found]:
        """The endpoints to report now that one of a server or client was found. Their messages go by
        RTPS."""
        part = service_part_from_dds(sample.topic_name, sample.type_name)
        if part is None:
            self._far.warn(
                f"'{sample.topic_name:.300}' of ROS 2 is left out: {sample.type_name!r:.300} is not its type"
            )
            return []
        topic = request_topic(part.service) if part.is_request else reply_topic(part.service)
        try:
            validate_full_topic_name(topic)
            types = self._services.find(part.type_name)
        except BridgeError as error:
            self._unknown_type(handle, participant, sample, kind)
            self._far.warn(f"service {part.service} of ROS 2 is left out: {error}")
            return []
        except ConfigurationError as error:
            reason = str(error).splitlines()[0]
            self._far.warn(f"service {part.service} of ROS 2 is left out: {reason}")
            return []
        schema = types.requests if part.is_request else types.replies
        profile = qos.OF_SERVICES if kind == "publisher" else keeping_all(qos.OF_SERVICES)
        found = Found(
            participant,
            FarEndpoint(kind, sample.key.bytes, "", topic, schema.type_name, schema.type_hash, profile),
        )
        is_of_client = part.is_request is (kind == "publisher")
        return self._client_pairs.added(found, part.service) if is_of_client else [found]

    def _unknown_type(self, handle: int, participant: bytes, sample: Any, kind: EndpointKind) -> None:
        """Keep an endpoint whose type is not known: it may become known."""
        gid = sample.key.bytes
        if gid in self._unknown or len(self._unknown) < _MOST_UNKNOWN:
            self._unknown[gid] = handle, participant, sample, kind
        else:
            self._far.warn(
                f"more than {_MOST_UNKNOWN:,} endpoints of ROS 2 have types that are not known here: "
                "further ones are left out until they are created again"
            )

    def _endpoint_removed(self, gid: bytes, handle: int) -> None:
        self.gids.pop(handle, None)
        self.handles.pop(gid, None)
        self._unknown.pop(gid, None)
        self._client_pairs.removed(gid)
        self.marked.discard(handle)
        if (topic := self._topics.pop(gid, None)) is not None:
            del self.publishers[topic][gid]
            if not self.publishers[topic]:
                del self.publishers[topic]
        if self.node_info is not None:
            self.node_info.writer_removed(handle)
        self._report(self._graph.endpoint_removed(gid))

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
        end = self._graph.next_time
        if self._timer is None and end is not None and not self._is_closed:
            self._timer = self._loop.call_later(max(end - time.monotonic(), 0.01), self._pass_time)

    def _pass_time(self) -> None:
        self._timer = None
        self._report(self._graph.pass_time(time.monotonic()))
