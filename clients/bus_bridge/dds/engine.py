"""The engine for DDS: shows nodes and topics of this bus in a DDS domain as ROS 2 does, and the reverse.

Owns: the bridge's requests, and two participants for them: one of cyclonedds for topics, one of our own RTPS
for services. The other modules do the separate tasks.
"""

import asyncio
import socket
from collections.abc import Callable, Sequence
from typing import Final

from bus.base.counted import counted
from bus.names import service_of_topic
from bus.qos import Liveliness
from bus.schema import MessageSchema
from bus_bridge.batch import Batch
from bus_bridge.dds.discovery import Discovery
from bus_bridge.dds.graph import DomainGraph, NodeEntities
from bus_bridge.dds.interfaces import LOOPBACK, address_of, check_interface
from bus_bridge.dds.known_types import KnownType, KnownTypes
from bus_bridge.dds.names import ENCLAVE, MARK, topic_to_dds, user_data
from bus_bridge.dds.node_info import NodeInfo
from bus_bridge.dds.options import DdsOptions
from bus_bridge.dds.participant import Participant
from bus_bridge.dds.qos import ReaderKind, kinds_for, of_publisher, of_subscription
from bus_bridge.dds.reading import FarWay, Intake, Ways
from bus_bridge.dds.service_types import KnownServices
from bus_bridge.dds.service_ways import ServiceWays
from bus_bridge.dds.services import Services
from bus_bridge.dds.writing import DdsWriter
from bus_bridge.engine import (
    FarBus,
    FarEndpoint,
    FarSide,
    LinkStatus,
    LocalEndpoint,
    LocalNode,
    Reader,
    RouteRule,
    Writer,
)
from bus_bridge.errors import BridgeError, NotCarried

__all__ = ["DdsEngine"]


_LEAVE_S: Final = 0.15
"""Time for Cyclone's threads to tell the domain that the bridge leaves."""


class _Node:
    def __init__(self, node: LocalNode) -> None:
        self.node = node
        self.readers: dict[bytes, None] = {}
        self.writers: dict[bytes, None] = {}


class DdsEngine:
    """An Engine. `bus`: the id of this bus. It marks our endpoints for the bridges of other busds.

    A domain is one far bus, `dds0` for domain 0: participants of ROS 2 are processes, not buses.
    """

    name = "ros2"
    has_numbers = False

    def __init__(self, bus: str, options: DdsOptions) -> None:
        self._options = options
        self.only_bus = f"dds{options.domain}"
        self._mark = {MARK: bus}
        self._nodes: dict[int, _Node] = {}
        self._writers: set[DdsWriter] = set()
        self._subscriptions: set[_Subscription] = set()
        self._participant: Participant | None = None
        self._left: Participant | None = None
        """The participant, after the end of everything else."""
        self._refusal = ""

    async def open(self, far: FarSide) -> None:
        self._far = far
        self._bus = FarBus(self.only_bus)
        # Its threads and sockets take some milliseconds, and no other task runs yet.
        participant = Participant(self._options, user_data({ENCLAVE: "/", **self._mark}))
        try:
            self._services = await self._open_services()
        except BaseException:
            participant.close()
            raise
        self._participant = participant
        self.types = KnownTypes()
        known = KnownServices()
        self._known_services = known
        self._service_ways = ServiceWays(self._services, known, user_data(self._mark), self._show_end)
        self._graph = DomainGraph(self._bus.id)
        self._discovery = Discovery(participant, self._graph, self.types, known, far, self._discovered)
        self._ways = Ways(self._discovery.marked)
        self._node_info = NodeInfo(
            participant,
            self._options.distro,
            self._mark,
            self._entities,
            self._discovery.nodes_said,
            far.warn,
        )
        far.bus_added(self._bus)
        self._discovery.open(self._node_info)
        self._say_nodes()

    async def close(self) -> None:
        try:
            if self._end() is not None:
                await asyncio.sleep(_LEAVE_S)
        finally:
            if self._left is not None:
                self._left.close()

    def announce_node(self, node: LocalNode) -> None:
        self._nodes[node.id] = _Node(node)
        self._say_nodes()

    def withdraw_node(self, node: LocalNode) -> None:
        self._nodes.pop(node.id, None)
        self._say_nodes()

    def announce_publisher(
        self,
        endpoint: LocalEndpoint,
        schema: MessageSchema,
        rule: RouteRule,
        on_change: Callable[[], None],
    ) -> Writer:
        participant = self._joined()
        if service_of_topic(endpoint.topic) is not None:
            return self._service_ways.announce_publisher(endpoint, schema, on_change)
        known = self._learn(schema)
        if endpoint.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self._far.warn(
                "ROS 2 sees publishers with manual liveliness as automatic: their assertions do not cross"
            )
        writer = DdsWriter(
            participant,
            topic_to_dds(endpoint.topic),
            known,
            of_publisher(endpoint.qos, rule.depth or known.depth),
            self._user_data(known),
            on_change,
            far=self._discovery.gids,
            on_close=lambda writer: self._writer_closed(writer, endpoint.node),
        )
        self._node_of(endpoint.node).writers[writer.gid] = None
        self._writers.add(writer)
        self._say_nodes()
        return writer

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        if service_of_topic(endpoint.topic) is not None:
            self._joined()
            return self._service_ways.announce_subscription(endpoint, schema)
        subscription = _Subscription(self, endpoint, self._learn(schema))
        try:
            subscription.adapt(self._far_kinds(endpoint.topic))
        except BridgeError:
            subscription.close()
            raise
        self._subscriptions.add(subscription)
        return lambda: self._withdraw_subscription(subscription)

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        known = self.types if service_of_topic(endpoint.topic) is None else self._known_services
        return known.schema_of(endpoint.type_name, endpoint.type_hash)

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
    ) -> Reader:
        if service_of_topic(endpoint.topic) is not None:
            return self._service_ways.read(endpoint, on_batch)
        handle = self._discovery.handles.get(endpoint.gid)
        if handle is None:
            raise BridgeError(f"the publisher of {endpoint.topic} has left DDS domain {self._options.domain}")
        known = self._learn(schema)
        way = FarWay(self._ways, endpoint.gid, handle, topic_to_dds(endpoint.topic), known, on_batch)
        self._ways.begin(way)
        return way

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        if announcer:
            self._discovery.refuse(announcer)
        elif bus_id == self._bus.id and not self._refusal:
            self._refusal = reason
            if (participant := self._end()) is not None:
                asyncio.get_running_loop().call_later(_LEAVE_S, participant.close)
            self._far.bus_removed(bus_id, reason)

    def links(self) -> Sequence[LinkStatus]:
        address = self._address()
        if self._refusal:
            return [LinkStatus(address, "refused", self._bus.id, self._refusal)]
        if self._participant is None:
            return []
        count, refused = self._graph.participants, len(self._discovery.refused)
        text = counted(count, "participant")
        return [LinkStatus(address, "up", self._bus.id, f"{text}, {refused} refused" if refused else text)]

    def refusals(self) -> tuple[int, str]:
        """As `Engine.refusals`. Always 0: DDS has no connections."""
        return 0, ""

    def make_intake(self, endpoint: LocalEndpoint, known: KnownType, kind: ReaderKind) -> Intake:
        """Make a reader for a subscription of this bus, shown to ROS 2. Raises NotCarried if the engine has
        ended."""
        participant = self._joined()
        policies = of_subscription(endpoint.qos, known.depth, kind)
        topic = topic_to_dds(endpoint.topic)
        intake = Intake(self._ways, participant, topic, known, policies, self._user_data(known))
        self._ways.add(intake)
        self._node_of(endpoint.node).readers[intake.gid] = None
        self._say_nodes()
        return intake

    def retire_intake(self, endpoint: LocalEndpoint, intake: Intake) -> None:
        """End the reader of a subscription that is no longer shown."""
        if (node := self._nodes.get(endpoint.node.id)) is not None:
            node.readers.pop(intake.gid, None)
        self._say_nodes()
        if self._participant is not None:
            self._ways.retire(intake)

    def _writer_closed(self, writer: DdsWriter, node: LocalNode) -> None:
        self._writers.discard(writer)
        if (known := self._nodes.get(node.id)) is not None:
            known.writers.pop(writer.gid, None)
        self._say_nodes()

    def _withdraw_subscription(self, subscription: "_Subscription") -> None:
        self._subscriptions.discard(subscription)
        subscription.close()

    def _end(self) -> Participant | None:
        """End everything except Cyclone's threads, which tell other participants. None if that was done
        before."""
        participant, self._participant = self._participant, None
        if participant is not None:
            self._left = participant
            self._discovery.close()
            self._node_info.close()
            self._ways.close()
            for writer in list(self._writers):
                writer.close()
            self._subscriptions.clear()
            self._service_ways.close()
            self._services.close()
            participant.leave()
        return participant

    def _joined(self) -> Participant:
        if self._participant is None:
            raise NotCarried(f"{self._address()} is ignored now: {self._refusal}")
        return self._participant

    def _discovered(self) -> None:
        for writer in self._writers:
            writer.update_matches()
        self._ways.keep_only(self._discovery.handles)
        for subscription in self._subscriptions:
            topic = subscription.endpoint.topic
            try:
                subscription.adapt(self._far_kinds(topic))
            except BridgeError as error:  # tried again with what is discovered next
                self._far.warn(f"not all messages on {topic} arrive here: {error}")

    def _far_kinds(self, topic: str) -> set[ReaderKind]:
        return set(self._discovery.publishers.get(topic, {}).values())

    async def _open_services(self) -> Services:
        """Join the domain by RTPS. Raises BridgeError."""
        options = self._options
        peers = []
        for peer in options.peers:
            try:
                found = await asyncio.get_running_loop().getaddrinfo(peer, None, family=socket.AF_INET)
            except OSError as error:
                self._far.warn(f"services of ROS 2 on {peer} are not reached: {error.strerror}")
            else:
                peers.append(found[0][4][0])
        if options.interface:
            check_interface(options.interface)
        return Services(
            options.domain,
            self._far.warn,
            lambda guid: self._service_ways.endpoint_gone(guid),
            host=LOOPBACK if options.is_local else address_of(options.interface),
            peers=tuple(map(str, peers)),
            user_data=user_data({ENCLAVE: "/", **self._mark}),
        )

    def _show_end(self, node: LocalNode, guids: tuple[bytes, bytes], is_there: bool) -> None:
        """List the reader and the writer of a service of ours under its node, or no longer."""
        if is_there:
            known = self._node_of(node)
            known.readers[guids[0]] = known.writers[guids[1]] = None
        elif (gone := self._nodes.get(node.id)) is not None:
            gone.readers.pop(guids[0], None)
            gone.writers.pop(guids[1], None)
        self._say_nodes()

    def _learn(self, schema: MessageSchema) -> KnownType:
        known = self.types.learn(schema)
        self._discovery.types_changed()
        return known

    def _node_of(self, node: LocalNode) -> _Node:
        return self._nodes.setdefault(node.id, _Node(node))

    def _say_nodes(self) -> None:
        if self._participant is not None:
            self._node_info.say()

    def _entities(self) -> list[NodeEntities]:
        return [
            NodeEntities(each.node.namespace, each.node.name, tuple(each.readers), tuple(each.writers))
            for each in self._nodes.values()
        ]

    def _user_data(self, known: KnownType) -> bytes:
        return user_data({"typehash": known.codec.type_hash, **self._mark})

    def _address(self) -> str:
        return f"DDS domain {self._options.domain} on {self._options.interface or 'loopback'}"


class _Subscription:
    """A subscription of this bus, and its readers. It has several if far publishers differ."""

    def __init__(self, engine: DdsEngine, endpoint: LocalEndpoint, known: KnownType) -> None:
        self.endpoint = endpoint
        self._engine = engine
        self._known = known
        self._intakes: dict[ReaderKind, Intake] = {}

    def adapt(self, far: set[ReaderKind]) -> None:
        """Make and end readers, so that they fit these far publishers."""
        wanted = kinds_for(self.endpoint.qos, far)
        if wanted == self._intakes.keys():
            return
        for kind in wanted - self._intakes.keys():
            self._intakes[kind] = self._engine.make_intake(self.endpoint, self._known, kind)
        for kind in self._intakes.keys() - wanted:
            self._engine.retire_intake(self.endpoint, self._intakes.pop(kind))

    def close(self) -> None:
        while self._intakes:
            self._engine.retire_intake(self.endpoint, self._intakes.popitem()[1])
