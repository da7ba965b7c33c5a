"""The engine for DDS: shows nodes and topics of this bus in a DDS domain as ROS 2 does, and the reverse.

Owns: the bridge's requests, and two participants for them: one of the carrier for topics, one of our own RTPS
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
from bus_bridge.dds.carrier import Carrier, TopicReader, TopicWriter
from bus_bridge.dds.discovery import Discovery
from bus_bridge.dds.graph import DomainGraph, NodeEntities
from bus_bridge.dds.idl import idl_type
from bus_bridge.dds.interfaces import LOOPBACK, address_of, check_interface
from bus_bridge.dds.names import ENCLAVE, MARK, user_data
from bus_bridge.dds.options import DdsOptions, parse_server
from bus_bridge.dds.qos import ReaderKind, kinds_for, of_publisher, of_subscription
from bus_bridge.dds.services import Services
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
from bus_bridge.ros2.known_types import KnownType, KnownTypes
from bus_bridge.ros2.service_types import KnownServices
from bus_bridge.ros2.service_ways import ServiceWays
from bus_bridge.rtps.reach import Reach

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

    def __init__(self, bus: str, options: DdsOptions) -> None:
        self._options = options
        self.only_bus = f"dds{options.domain}"
        self.has_numbers = options.carrier_used == "rtps"
        self._mark = {MARK: bus}
        self._nodes: dict[int, _Node] = {}
        self._writers: set[TopicWriter] = set()
        self._subscriptions: set[_Subscription] = set()
        self._carrier: Carrier | None = None
        self._left: Carrier | None = None
        """The carrier, after the end of everything else."""
        self._refusal = ""

    async def open(self, far: FarSide) -> None:
        self._far = far
        self._bus = FarBus(self.only_bus)
        reach = await self._find_network()
        carrier = self._make_carrier(reach)
        try:
            self._services = self._join_services(reach)
        except BaseException:
            carrier.close()
            raise
        self._carrier = carrier
        self.types = KnownTypes(None if self.has_numbers else idl_type)
        known = KnownServices()
        self._known_services = known
        self._service_ways = ServiceWays(self._services, known, user_data(self._mark), self._show_end)
        self._graph = DomainGraph(self._bus.id)
        self._discovery = Discovery(self._graph, self.types, known, far, self._discovered)
        self._discovery.node_topic = carrier.open(self._discovery, self._entities, far.warn)
        far.bus_added(self._bus)  # it may refuse the domain at once
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
        carrier = self._joined()
        if service_of_topic(endpoint.topic) is not None:
            return self._service_ways.announce_publisher(endpoint, schema, on_change)
        known = self._learn(schema)
        if endpoint.qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self._far.warn(
                "ROS 2 sees publishers with manual liveliness as automatic: their assertions do not cross"
            )
        writer = carrier.make_writer(
            endpoint,
            known,
            of_publisher(endpoint.qos, rule.depth or known.depth),
            on_change,
            lambda writer: self._writer_closed(writer, endpoint.node),
        )
        self._writers.add(writer)
        self._node_of(endpoint.node).writers[writer.gid] = None
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
        *,
        restores: bool = False,
    ) -> Reader:
        if service_of_topic(endpoint.topic) is not None:
            return self._service_ways.read(endpoint, on_batch)
        handle = self._discovery.handles.get(endpoint.gid)
        if handle is None:
            raise BridgeError(f"the publisher of {endpoint.topic} has left DDS domain {self._options.domain}")
        carrier, known = self._joined(), self._learn(schema)
        if restores:  # DDS sends kept messages to each reader once
            for subscription in self._subscriptions:
                if subscription.endpoint.topic == endpoint.topic:
                    subscription.renew()
        return carrier.read(endpoint, handle, known, on_batch, restores=restores)

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        if announcer:
            self._discovery.refuse(announcer)
        elif bus_id == self._bus.id and not self._refusal:
            self._refusal = reason
            if (carrier := self._end()) is not None:
                asyncio.get_running_loop().call_later(_LEAVE_S, carrier.close)
            self._far.bus_removed(bus_id, reason)

    def links(self) -> Sequence[LinkStatus]:
        address = self._address()
        if self._refusal:
            return [LinkStatus(address, "refused", self._bus.id, self._refusal)]
        if self._carrier is None:
            return []
        count, refused = self._graph.participants, len(self._discovery.refused)
        text = counted(count, "participant")
        return [LinkStatus(address, "up", self._bus.id, f"{text}, {refused} refused" if refused else text)]

    def refusals(self) -> tuple[int, str]:
        """As `Engine.refusals`. Always 0: DDS has no connections."""
        return 0, ""

    def make_reader(self, endpoint: LocalEndpoint, known: KnownType, kind: ReaderKind) -> TopicReader:
        """Make a reader for a subscription of this bus, shown to ROS 2. Raises NotCarried if the engine has
        ended."""
        policies = of_subscription(endpoint.qos, known.depth, kind)
        reader = self._joined().make_reader(endpoint, known, policies)
        self._node_of(endpoint.node).readers[reader.gid] = None
        self._say_nodes()
        return reader

    def retire_reader(self, endpoint: LocalEndpoint, reader: TopicReader) -> None:
        """End the reader of a subscription that is no longer shown."""
        if (node := self._nodes.get(endpoint.node.id)) is not None:
            node.readers.pop(reader.gid, None)
        self._say_nodes()
        if self._carrier is not None:
            self._carrier.retire_reader(reader)

    def _writer_closed(self, writer: TopicWriter, node: LocalNode) -> None:
        self._writers.discard(writer)
        if (known := self._nodes.get(node.id)) is not None:
            known.writers.pop(writer.gid, None)
        self._say_nodes()

    def _withdraw_subscription(self, subscription: "_Subscription") -> None:
        self._subscriptions.discard(subscription)
        subscription.close()

    def _end(self) -> Carrier | None:
        """End everything except the carrier's threads, which tell other participants. None if that was done
        before."""
        carrier, self._carrier = self._carrier, None
        if carrier is not None:
            self._left = carrier
            self._discovery.close()
            for writer in list(self._writers):
                writer.close()
            self._subscriptions.clear()
            self._service_ways.close()
            self._services.close()
            carrier.leave()
        return carrier

    def _joined(self) -> Carrier:
        if self._carrier is None:
            raise NotCarried(f"{self._address()} is ignored now: {self._refusal}")
        return self._carrier

    def _discovered(self) -> None:
        for writer in list(self._writers):
            writer.update()
        if self._carrier is not None:
            self._carrier.update()
        for subscription in self._subscriptions:
            topic = subscription.endpoint.topic
            try:
                subscription.adapt(self._far_kinds(topic))
            except BridgeError as error:  # tried again with what is discovered next
                self._far.warn(f"not all messages on {topic} arrive here: {error}")

    def _far_kinds(self, topic: str) -> set[ReaderKind]:
        return set(self._discovery.publishers.get(topic, {}).values())

    def _make_carrier(self, reach: Reach) -> Carrier:
        """Join the domain, for topics. Raises BridgeError."""
        if self.has_numbers:
            from bus_bridge.dds.rtps_topics import RtpsCarrier

            return RtpsCarrier(self._options.domain, reach, self._mark, self._options.distro)
        from bus_bridge.dds.cyclone import CycloneCarrier

        return CycloneCarrier(
            self._options,
            self._mark,
            lambda reader, writer: self._services.participant.ask_for_heartbeat(reader, writer),
        )

    async def _find_network(self) -> Reach:
        """The place of our participants, with addresses instead of names. Raises BridgeError."""
        options = self._options
        peers = [found for peer in options.peers if (found := await self._resolved(peer)) is not None]
        servers = []
        for host, port in map(parse_server, options.servers):
            if (address := await self._resolved(host)) is not None:
                servers.append((address, port))
        if options.servers and not servers:
            raise BridgeError(f"no Discovery Server can be reached: {', '.join(options.servers)}")
        if options.interface:
            check_interface(options.interface)
        host = LOOPBACK if options.is_local else address_of(options.interface)
        return Reach(host, tuple(peers), options.discovery, tuple(servers))

    async def _resolved(self, host: str) -> str | None:
        """The IPv4 address of a machine; None, with a warning, if its name has none."""
        try:
            found = await asyncio.get_running_loop().getaddrinfo(host, None, family=socket.AF_INET)
        except OSError as error:
            self._far.warn(f"the RTPS of busd does not reach {host}: {error.strerror}")
            return None
        return str(found[0][4][0])

    def _join_services(self, reach: Reach) -> Services:
        """Join the domain, for services. Raises BridgeError."""
        return Services(
            self._options.domain,
            self._far.warn,
            lambda guid: self._service_ways.endpoint_gone(guid),
            reach=reach,
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
        if self._carrier is not None:
            self._carrier.say_nodes()

    def _entities(self) -> list[NodeEntities]:
        return [
            NodeEntities(each.node.namespace, each.node.name, tuple(each.readers), tuple(each.writers))
            for each in self._nodes.values()
        ]

    def _address(self) -> str:
        return f"DDS domain {self._options.domain} on {self._options.interface or 'loopback'}"


class _Subscription:
    """A subscription of this bus, and its readers. It has several if far publishers differ."""

    def __init__(self, engine: DdsEngine, endpoint: LocalEndpoint, known: KnownType) -> None:
        self.endpoint = endpoint
        self._engine = engine
        self._known = known
        self._readers: dict[ReaderKind, TopicReader] = {}

    def adapt(self, far: set[ReaderKind]) -> None:
        """Make and end readers to fit these far publishers."""
        wanted = kinds_for(self.endpoint.qos, far)
        if wanted == self._readers.keys():
            return
        for kind in wanted - self._readers.keys():
            self._readers[kind] = self._engine.make_reader(self.endpoint, self._known, kind)
        for kind in self._readers.keys() - wanted:
            self._engine.retire_reader(self.endpoint, self._readers.pop(kind))

    def renew(self) -> None:
        """Make the readers that get kept messages again. Raises BridgeError."""
        for kind, former in list(self._readers.items()):
            if kind.transient_local:
                self._readers[kind] = self._engine.make_reader(self.endpoint, self._known, kind)
                self._engine.retire_reader(self.endpoint, former)

    def close(self) -> None:
        while self._readers:
            self._engine.retire_reader(self.endpoint, self._readers.popitem()[1])
