"""The engine for DDS with the half of a bridge that it needs, and participants of cyclonedds beside it."""

import asyncio
import os
import time
from collections.abc import Callable
from typing import Any

import msgspec
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from bus.msg.std_msgs import String
from bus.qos import Durability, History, QoSProfile, Reliability
from bus.schema import MessageSchema
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.dds import raw
from bus_bridge.dds.engine import DdsEngine
from bus_bridge.dds.node_topic import info_type
from bus_bridge.dds.options import DdsOptions
from bus_bridge.dds.participant import configuration
from bus_bridge.dds.rtps_topics import RtpsCarrier
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, LocalEndpoint, LocalNode, RouteRule, Writer
from conftest import WAIT_S
from ports import own_domain

DOMAIN = own_domain()
STRING = MessageSchema.of(String)
NODE = LocalNode(1, "busd_node", "/robot")
LATCHED = QoSProfile(1, durability=Durability.TRANSIENT_LOCAL)
BEST = QoSProfile(10, reliability=Reliability.BEST_EFFORT, durability=Durability.BEST_AVAILABLE)
DEFAULT = QoSProfile()
OPTIONS = DdsOptions(DOMAIN)
LOSSLESS = QoSProfile(history=History.KEEP_ALL)
DDS_STRING = make_idl_struct("String_", "std_msgs::msg::dds_::String_", {"data": str}, dataclassify=False)


class Far:
    """The bridge, as an engine sees it: remembers what it is told."""

    def __init__(self) -> None:
        self.buses: dict[str, FarBus] = {}
        self.nodes: dict[str, FarNode] = {}
        self.endpoints: dict[bytes, FarEndpoint] = {}
        self.warnings: list[str] = []

    def bus_added(self, bus: FarBus) -> None:
        self.buses[bus.id] = bus

    def bus_removed(self, bus_id: str, reason: str) -> None:
        del self.buses[bus_id]

    def node_added(self, node: FarNode) -> None:
        assert node.key not in self.nodes and node.bus in self.buses
        self.nodes[node.key] = node

    def node_removed(self, key: str) -> None:
        del self.nodes[key]

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        assert endpoint.gid not in self.endpoints and endpoint.node in self.nodes
        self.endpoints[endpoint.gid] = endpoint

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        assert self.endpoints.pop(gid).node == node

    def warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def names(self) -> list[str]:
        return sorted(f"{node.namespace.rstrip('/')}/{node.name}" for node in self.nodes.values())

    def find(self, kind: str, topic: str) -> FarEndpoint | None:
        return next((one for one in self.endpoints.values() if (one.kind, one.topic) == (kind, topic)), None)


async def until(holds: Callable[[], Any], what: str = "") -> Any:
    """What `holds` returns, once it is true."""
    end = time.monotonic() + WAIT_S
    while not (found := holds()):
        assert time.monotonic() < end, what or "it did not come"
        await asyncio.sleep(0.005)
    return found


class Bridge:
    """An engine, and the half of a bridge that it needs."""

    def __init__(self, options: DdsOptions = OPTIONS) -> None:
        self.options = options
        self._domain: Any = None
        self.far = Far()
        self.engine = DdsEngine("robot-1a2b3c4d", options)
        self.heard: list[str] = []
        self.numbers = 0

    async def open(self) -> None:
        if self.options.carrier == "rtps":  # else the engine configures the domain, also for `Alone`
            self._domain = Domain(DOMAIN, configuration(self.options))
        await self.engine.open(self.far)
        self.engine.announce_node(NODE)

    async def close(self) -> None:
        await self.engine.close()
        if self._domain is not None:
            raw.delete(self._domain)

    def publish(
        self,
        topic: str,
        qos: QoSProfile = DEFAULT,
        schema: MessageSchema = STRING,
        on_change: Callable[[], None] = lambda: None,
    ) -> Writer:
        return self.engine.announce_publisher(
            _local("publisher", topic, qos, schema), schema, RouteRule(), on_change
        )

    def listen(
        self, topic: str, qos: QoSProfile = DEFAULT, schema: MessageSchema = STRING
    ) -> Callable[[], None]:
        return self.engine.announce_subscription(_local("subscription", topic, qos, schema), schema)

    def send(self, writer: Writer, *texts: str) -> None:
        for text in texts:
            self.numbers += 1
            assert writer.write(Loose([sample_of(text, self.numbers)])) == 1

    async def read(self, topic: str) -> Any:
        """From now on what its publisher says is in `heard`."""
        endpoint = await until(lambda: self.far.find("publisher", topic), f"no publisher of {topic}")
        way = self.engine.read(endpoint, await self.engine.find_schema(endpoint), self.hear)
        if isinstance(carrier := self.engine._carrier, RtpsCarrier):
            # Each side finds the other one by itself: the publisher may not know the reader yet.
            await until(
                lambda: all(_is_known(one, endpoint) for one in carrier._readers.get(f"rt{topic}", ()))
            )
        return way

    def hear(self, batch: Batch) -> None:
        self.heard += [msgspec.msgpack.decode(sample.payload)[0] for sample in batch]


def _is_known(reader: Any, endpoint: FarEndpoint) -> bool:
    """Whether a publisher knows a reader of our RTPS; without reliability there is no way to tell."""
    if not reader.policies.reliable or endpoint.qos.reliability is not Reliability.RELIABLE:
        return True
    return bool(reader.local.reader.is_following(endpoint.gid))


def _local(kind: Any, topic: str, qos: QoSProfile, schema: MessageSchema = STRING) -> LocalEndpoint:
    return LocalEndpoint(kind, os.urandom(16), NODE, topic, schema.type_name, schema.type_hash, qos)


def sample_of(text: str, number: int = 0) -> Sample:
    return Sample(msgspec.msgpack.encode([text]), number, time.time_ns())


class Alone:
    """A participant of cyclonedds in this process, which speaks no ROS 2."""

    def __init__(self, user_data: bytes = b"") -> None:
        self.user_data = Policy.Userdata(user_data)
        self.participant = DomainParticipant(DOMAIN, Qos(self.user_data))
        self._topics: dict[str, Any] = {}

    def topic(self, name: str, idl_type: Any = DDS_STRING) -> Any:
        if name not in self._topics:
            self._topics[name] = Topic(self.participant, name, idl_type)
        return self._topics[name]

    def writer(self, topic: str, *policies: Any) -> Any:
        qos = Qos(
            *(policies or (Policy.Reliability.Reliable(0), Policy.History.KeepLast(1000))), self.user_data
        )
        return DataWriter(self.participant, self.topic(f"rt{topic}"), qos)

    def reader(self, topic: str, *policies: Any) -> Any:
        qos = Qos(*(policies or (Policy.Reliability.Reliable(0), Policy.History.KeepAll)), self.user_data)
        return DataReader(self.participant, self.topic(f"rt{topic}"), qos)

    def info_reader(self, size: int) -> DataReader:
        """A reader of `ros_discovery_info` in the form with gids of `size` bytes."""
        latched = Policy.Reliability.Reliable(0), Policy.Durability.TransientLocal, Policy.History.KeepAll
        return DataReader(self.participant, self.topic("ros_discovery_info", info_type(size)), Qos(*latched))

    def close(self) -> None:
        raw.delete(self.participant)


def cdr(text: str) -> bytes:
    body = text.encode() + b"\0"
    return b"\0\1\0\0" + len(body).to_bytes(4, "little") + body + bytes(-len(body) % 4)


def say(writer: Any, *texts: str) -> None:
    for text in texts:
        assert raw.writer_of(writer)(cdr(text), time.time_ns()) == 0


def taken(reader: Any) -> list[str]:
    found = raw.taker_of(reader)(1000)
    return [data[8:].rstrip(b"\0").decode() for data, info in found if info.valid_data]
