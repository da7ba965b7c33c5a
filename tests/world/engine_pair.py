"""Engines without a network: bridges in one process, joined by links that tests can cut and stop."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from bus.qos import Durability
from bus.schema import MessageSchema
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import (
    FarBus,
    FarEndpoint,
    FarNode,
    FarSide,
    LinkStatus,
    LocalEndpoint,
    LocalNode,
    RouteRule,
)
from bus_bridge.errors import BridgeError

__all__ = ["Network", "PairEngine", "Switch"]

WINDOW_BYTES = 256 * 1024
_DEPTH = 1000


class Switch:
    """One link between two engines, and its faults."""

    def __init__(self, one: "PairEngine", other: "PairEngine") -> None:
        self.ends = one, other
        self.is_up = False
        self.hangs = False
        """Nothing arrives for now; it waits."""
        self.change: Callable[[list[Sample]], list[Sample]] = lambda samples: samples
        """Changes samples in transit: lost, repeated, out of order."""
        self.crossed = 0
        """The number of samples that arrived."""
        self._held: deque[Callable[[], None]] = deque()

    def up(self) -> None:
        if not self.is_up:
            self.is_up = True
            for one, other in (self.ends, self.ends[::-1]):
                one.link_added(other)

    def down(self) -> None:
        if self.is_up:
            self.is_up = False
            self._held.clear()
            for one, other in (self.ends, self.ends[::-1]):
                one.link_removed(other)

    def hang(self) -> None:
        self.hangs = True

    def go_on(self) -> None:
        self.hangs = False
        asyncio.get_running_loop().call_soon(self._deliver)

    def carry(self, act: Callable[[], None]) -> None:
        """Call `act` at the other end, in order."""
        if self.is_up:
            self._held.append(act)
            asyncio.get_running_loop().call_soon(self._deliver)

    def _deliver(self) -> None:
        while self._held and not self.hangs and self.is_up:
            self._held.popleft()()


class Network:
    """The links of some engines."""

    def __init__(self) -> None:
        self.links: list[Switch] = []

    def join(self, one: "PairEngine", other: "PairEngine") -> Switch:
        """A link between two engines; it is up once both are open."""
        link = Switch(one, other)
        self.links.append(link)
        one.links_to[other] = other.links_to[one] = link
        if one.far is not None and other.far is not None:
            link.up()
        return link


class _Writer:
    def __init__(self, engine: "PairEngine", local: LocalEndpoint, on_change: Callable[[], None]) -> None:
        self.engine = engine
        self.local = local
        self.on_change = on_change
        self.readers: dict[_Reader, int] = {}
        """Bytes in transit, by reader."""
        keeps = local.qos.durability is Durability.TRANSIENT_LOCAL
        self.history: deque[Sample] = deque(maxlen=local.qos.depth if keeps else 0)
        self.lost: dict[str, int] = {}
        self.is_closed = False

    @property
    def is_wanted(self) -> bool:
        return bool(self.readers)

    def write(self, batch: Batch) -> int:
        sent = batch.count
        if self.local.qos.is_lossless and self.readers:
            sent, room = 0, WINDOW_BYTES - max(self.readers.values())
            for sample in batch:
                if room <= 0:
                    break
                room -= len(sample.payload)
                sent += 1
        samples = list(batch)[:sent]
        self.history.extend(samples)
        size = sum(len(sample.payload) for sample in samples)
        for reader in self.readers:
            self.readers[reader] += size
            reader.send(samples)
        return sent

    def close(self) -> None:
        self.is_closed = True
        self.engine.forget(self)


class _Reader:
    def __init__(self, link: Switch, writer: _Writer, on_batch: Callable[[Batch], None]) -> None:
        self.lost: dict[str, int] = {}
        self._link = link
        self._writer = writer
        self._on_batch = on_batch
        self.is_closed = False
        link.carry(self._want)

    def _want(self) -> None:
        if not self.is_closed and not self._writer.is_closed:
            self._writer.readers[self] = 0
            if self._writer.history:
                self.send(list(self._writer.history))
            self._writer.on_change()

    def send(self, samples: list[Sample]) -> None:
        self._link.carry(lambda: self._arrive(samples))

    def _arrive(self, samples: list[Sample]) -> None:
        if not self.is_closed:
            changed = self._link.change(samples)
            self._link.crossed += len(changed)
            if changed:
                self._on_batch(Loose(changed))

    def taken(self, size: int) -> None:
        self._link.carry(lambda: self._credit(size))

    def _credit(self, size: int) -> None:
        if self in self._writer.readers:
            self._writer.readers[self] -= size
            self._writer.on_change()

    def close(self) -> None:
        self.is_closed = True
        self._link.carry(lambda: self.leave())

    def leave(self) -> None:
        if self._writer.readers.pop(self, None) is not None:
            self._writer.on_change()


class PairEngine:
    """The engine of the bus `bus`. Without links it has no peers."""

    name = "pair"
    has_numbers = True
    only_bus = ""

    def __init__(self, bus: str) -> None:
        self.bus = bus
        self.far: FarSide | None = None
        self.links_to: dict[PairEngine, Switch] = {}
        self.refused: list[tuple[str, str]] = []
        self.nodes: dict[int, LocalNode] = {}
        self.endpoints: dict[bytes, tuple[LocalEndpoint, MessageSchema]] = {}
        self.writers: dict[bytes, _Writer] = {}
        self.announced: list[LocalEndpoint] = []
        """All announced endpoints so far, in order."""
        self.readers: list[_Reader] = []
        self.refuses: Callable[[LocalEndpoint], str] = lambda endpoint: ""
        self.epoch = 0

    async def open(self, far: FarSide) -> None:
        self.far = far
        self.epoch += 1
        for other, link in self.links_to.items():
            if other.far is not None:
                link.up()

    async def close(self) -> None:
        for link in self.links_to.values():
            link.down()
        self.far = None
        self.nodes.clear()
        self.endpoints.clear()
        self.writers.clear()

    def refusals(self) -> tuple[int, str]:
        return 0, ""

    # --- this bus

    def announce_node(self, node: LocalNode) -> None:
        assert node.id not in self.nodes
        self.nodes[node.id] = node
        self._tell(lambda far: far.node_added(self._far_node(node)))

    def withdraw_node(self, node: LocalNode) -> None:
        del self.nodes[node.id]
        assert all(one.node.id != node.id for one, _ in self.endpoints.values())
        self._tell(lambda far: far.node_removed(self._key(node)))

    def announce_publisher(
        self, endpoint: LocalEndpoint, schema: MessageSchema, rule: RouteRule, on_change: Callable[[], None]
    ) -> _Writer:
        self._announce(endpoint, schema)
        writer = self.writers[endpoint.gid] = _Writer(self, endpoint, on_change)
        return writer

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        self._announce(endpoint, schema)
        return lambda: self._withdraw(endpoint)

    def forget(self, writer: _Writer) -> None:
        if self.writers.get(writer.local.gid) is writer:
            del self.writers[writer.local.gid]
            self._withdraw(writer.local)

    def _announce(self, endpoint: LocalEndpoint, schema: MessageSchema) -> None:
        if wrong := self.refuses(endpoint):
            raise BridgeError(wrong)
        assert endpoint.gid not in self.endpoints
        assert endpoint.node.id in self.nodes
        self.endpoints[endpoint.gid] = endpoint, schema
        self.announced.append(endpoint)
        self._tell(lambda far: far.endpoint_added(self._far_endpoint(endpoint)))

    def _withdraw(self, endpoint: LocalEndpoint) -> None:
        self.endpoints.pop(endpoint.gid, None)
        self._tell(lambda far: far.endpoint_removed(endpoint.gid, self._key(endpoint.node)))

    # --- other buses

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        for other, link in self.links_to.items():
            if link.is_up and endpoint.gid in other.endpoints:
                return other.endpoints[endpoint.gid][1]
        raise BridgeError(f"nobody knows {endpoint.type_name}")

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool = False,
    ) -> _Reader:
        bus = endpoint.node.partition("/")[0]
        for other, link in self.links_to.items():
            if other.bus == bus and link.is_up and endpoint.gid in other.writers:
                reader = _Reader(link, other.writers[endpoint.gid], on_batch)
                self.readers.append(reader)
                return reader
        raise BridgeError(f"nobody has '{endpoint.topic}'")

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        self.refused.append((bus_id, reason))
        for other, link in self.links_to.items():
            if other.bus == bus_id:
                link.down()

    def links(self) -> Sequence[LinkStatus]:
        return [
            LinkStatus(f"pair/{other.bus}", "up" if link.is_up else "trying", other.bus)
            for other, link in self.links_to.items()
        ]

    # --- links

    def link_added(self, other: "PairEngine") -> None:
        """Send the other end everything that is here."""
        assert other.far is not None
        other.far.bus_added(FarBus(self.bus))
        for node in self.nodes.values():
            other.far.node_added(self._far_node(node))
        for endpoint, _ in self.endpoints.values():
            other.far.endpoint_added(self._far_endpoint(endpoint))

    def link_removed(self, other: "PairEngine") -> None:
        for writer in self.writers.values():
            for reader in tuple(writer.readers):
                if self.links_to[other] is reader._link:
                    reader.leave()
        if other.far is not None:
            other.far.bus_removed(self.bus, "the link has ended")

    def _tell(self, act: Callable[[Any], None]) -> None:
        for other, link in self.links_to.items():

            def say(other: PairEngine = other) -> None:
                if other.far is not None:
                    act(other.far)

            link.carry(say)

    def _key(self, node: LocalNode) -> str:
        return f"{self.bus}/{self.epoch}.{node.id}"

    def _far_node(self, node: LocalNode) -> FarNode:
        return FarNode(self._key(node), self.bus, node.name, node.namespace, node.via)

    def _far_endpoint(self, one: LocalEndpoint) -> FarEndpoint:
        return FarEndpoint(
            one.kind, one.gid, self._key(one.node), one.topic, one.type_name, one.type_hash, one.qos
        )
