"""The order in which mirrors are made, and mirrors that stay while the link is away."""

import asyncio
import time
from typing import Any
from unittest.mock import AsyncMock, Mock

import pytest

from bus.names import reply_topic, request_topic
from bus.qos import Durability, QoSProfile
from bus_bridge.batch import Loose, Sample
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.far_graph import FarGraph
from bus_bridge.core.mirrors import Mirrors
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from bus_bridge.engine import EndpointKind, FarBus, FarEndpoint, FarNode
from semantics import until

NODE = "node"
REQUESTS, REPLIES = request_topic("/add"), reply_topic("/add")


class World:
    """Mirrors of one far node. The mirror of a subscription on "/slow" is not made before `is_free`."""

    def __init__(self) -> None:
        self.far = FarGraph("here", Bounds(), Rules(), Naming(""))
        self.far.bus_added(FarBus("there"), 0.0)
        self.far.node_added(FarNode(NODE, "there", "node", "/"), 0.0)
        self.is_free = asyncio.Event()
        self.began: list[str] = []
        self.made: list[str] = []
        node = Mock(open=AsyncMock(), close=AsyncMock())
        node.create_subscription = self._create_subscription
        node.create_publisher = self._create_publisher
        exports = Mock(hold=AsyncMock(return_value=Mock(mirrors={}, sent=0)))
        self.mirrors = Mirrors(
            Mock(), self.far, exports, Mock(), lambda *_: node, Mock(return_value=False), Mock()
        )

    def add(self, kind: EndpointKind, topic: str, node: str = NODE) -> None:
        gid = len(self.far.endpoints).to_bytes(16, "big")
        endpoint = FarEndpoint(kind, gid, node, topic, "std_msgs/msg/String", "h", QoSProfile(10))
        assert self.far.endpoint_added(endpoint, 0.0) is None
        self.mirrors.notify()

    async def _create_subscription(self, schema: Any, topic: str, *_: Any, **__: Any) -> Any:
        self.began.append(topic)
        if topic == "/slow":
            await self.is_free.wait()
        self.made.append(topic)
        return Mock(matches=(), close=AsyncMock())

    async def _create_publisher(self, schema: Any, topic: str, *_: Any, **__: Any) -> Any:
        self.made.append(topic)
        return Mock(matches=(), close=AsyncMock())


@pytest.mark.parametrize(
    "endpoints",
    [
        pytest.param((("subscription", REPLIES), ("publisher", REQUESTS)), id="a client"),
        pytest.param((("publisher", REPLIES), ("subscription", REQUESTS)), id="a server"),
    ],
)
@pytest.mark.parametrize("is_reversed", [False, True])
async def test_the_order_of_the_ends_of_a_service(
    endpoints: tuple[tuple[EndpointKind, str], ...], is_reversed: bool
) -> None:
    """Also of ends that come while another mirror is being made."""
    world = World()
    world.add("subscription", "/slow")
    task = asyncio.create_task(world.mirrors.run())
    await until(lambda: world.began == ["/slow"])
    for kind, topic in reversed(endpoints) if is_reversed else endpoints:
        world.add(kind, topic)
    world.is_free.set()
    await until(lambda: len(world.made) == 3)
    assert world.made == ["/slow", *(topic for _, topic in endpoints)]
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await world.mirrors.close()


class Twins:
    """Mirrors of two far nodes of one name, each with a transient local publisher."""

    def __init__(self) -> None:
        self.far = FarGraph("here", Bounds(), Rules(), Naming(""))
        self.nodes: list[Any] = []
        self.publishers: list[Any] = []
        self.mirrors = Mirrors(
            Mock(), self.far, Mock(), Mock(), self._make_node, Mock(return_value=False), Mock()
        )

    def come(self, *keys: str) -> None:
        """The publishers come with the link. They belong to nodes with these keys."""
        self.far.bus_added(FarBus("there"), 0.0)
        for key in sorted(keys):
            self.far.node_added(FarNode(key, "there", "node", "/"), 0.0)
        for number, key in enumerate(keys):
            self._add_publisher(number, key)
        self.mirrors.bus_added("there")
        self.mirrors.notify()

    def add(self, number: int, key: str) -> None:
        """A node and its publisher come."""
        self.far.node_added(FarNode(key, "there", "node", "/"), 0.0)
        self._add_publisher(number, key)

    def _add_publisher(self, number: int, key: str) -> None:
        qos = QoSProfile(1, durability=Durability.TRANSIENT_LOCAL)
        gid = number.to_bytes(16, "big")
        endpoint = FarEndpoint("publisher", gid, key, "/map", "std_msgs/msg/String", "h", qos)
        assert self.far.endpoint_added(endpoint, 0.0) is None

    def lose(self) -> None:
        """The link ends."""
        self.far.bus_removed("there")
        self.mirrors.bus_removed("there")
        self.mirrors.notify()

    def is_settled(self) -> bool:
        """Whether the mirrors are the far graph's."""
        mirrored = {id(mirror.far) for mirror in self.mirrors if mirror.is_open}
        return mirrored == set(map(id, self.far.endpoints.values()))

    def _make_node(self, *_: Any) -> Any:
        node = Mock(open=AsyncMock(), close=AsyncMock(), create_publisher=self._create_publisher)
        self.nodes.append(node)
        return node

    async def _create_publisher(self, *_: Any, **__: Any) -> Any:
        self.publishers.append(Mock(matches=(), close=AsyncMock()))
        return self.publishers[-1]


@pytest.mark.parametrize(
    "returns",
    [
        pytest.param((("1", "2"), ("1", "2")), id="the same keys"),
        pytest.param((("3", "4"), ("5", "6")), id="other keys"),
        pytest.param((("4", "3"), ("6", "5")), id="other keys in another order"),
        pytest.param((("2", "3"), ("3", "4")), id="a key of the other node"),
    ],
)
async def test_two_nodes_of_one_name_stay_while_the_link_is_away(
    returns: tuple[tuple[str, str], ...],
) -> None:
    """So their publishers repeat no history, and no node stays open without an original."""
    world = Twins()
    task = asyncio.create_task(world.mirrors.run())
    world.come("1", "2")
    await until(world.is_settled)
    for keys in returns:
        world.lose()
        await asyncio.sleep(0)
        world.come(*keys)
        await until(world.is_settled)
    assert world.mirrors.counts == (2, 2, 0)
    assert (len(world.nodes), len(world.publishers)) == (2, 2)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await world.mirrors.close()
    assert all(node.close.await_count == 1 for node in world.nodes)


@pytest.mark.parametrize("first", [0, 1])
async def test_two_nodes_of_one_name_return_one_after_the_other(first: int) -> None:
    """Each gets the mirror of its own publisher, so no history repeats."""
    world = Twins()
    task = asyncio.create_task(world.mirrors.run())
    world.come("1", "2")
    await until(world.is_settled)
    world.lose()
    await asyncio.sleep(0)
    world.far.bus_added(FarBus("there"), 0.0)
    for number in (first, 1 - first):
        world.add(number, f"new {number}")
        world.mirrors.notify()
        for _ in range(20):
            await asyncio.sleep(0)
    await until(world.is_settled)
    assert world.mirrors.counts == (2, 2, 0)
    assert (len(world.nodes), len(world.publishers)) == (2, 2)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await world.mirrors.close()


async def test_the_clock_of_one_participant_expires_no_messages_of_another() -> None:
    """Participants of ROS 2 are on one bus, but on several machines."""
    far = FarGraph("here", Bounds(), Rules(), Naming(""))
    sent: list[bytes] = []
    publisher = Mock(matches=(), close=AsyncMock())

    def publish(payload: bytes, **_: Any) -> bool:
        sent.append(payload)
        return True

    publisher.publish_encoded = publish
    node = Mock(open=AsyncMock(), close=AsyncMock(), create_publisher=AsyncMock(return_value=publisher))
    mirrors = Mirrors(Mock(), far, Mock(), Mock(), lambda *_: node, Mock(return_value=False), Mock())
    far.bus_added(FarBus("dds0"), 0.0)
    for name in ("ahead", "right"):
        far.node_added(FarNode(name, "dds0", name, "/", announcer=name), 0.0)
        qos = QoSProfile(10, lifespan=0.5)
        gid = name.encode().ljust(16, b".")
        endpoint = FarEndpoint("publisher", gid, name, "/scan", "std_msgs/msg/String", "h", qos)
        assert far.endpoint_added(endpoint, 0.0) is None
    mirrors.notify()
    task = asyncio.create_task(mirrors.run())
    await until(lambda: all(mirror.is_open for mirror in mirrors) and len([*mirrors]) == 2)
    now_ns = time.time_ns()
    for mirror in mirrors:
        is_ahead = mirror.node.far.name == "ahead"
        assert mirror.way is not None
        mirror.way.receive(Loose([Sample(b"x", 1, now_ns + 3_600_000_000_000 * is_ahead)]))
    assert sent == [b"x", b"x"]
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await mirrors.close()
