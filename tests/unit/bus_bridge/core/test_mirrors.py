"""The order in which mirrors are made."""

import asyncio
from typing import Any
from unittest.mock import AsyncMock, Mock

import pytest

from bus.names import reply_topic, request_topic
from bus.qos import QoSProfile
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


async def test_the_clock_of_one_program_says_nothing_about_those_of_other_programs() -> None:
    """A domain of ROS 2 is one bus, with programs on several machines."""
    world = World()
    for node, announcer in (("1", "one"), ("2", "one"), ("3", "other")):
        world.far.node_added(FarNode(node, "there", f"node{node}", "/", announcer=announcer), 0.0)
        world.add("publisher", f"/topic{node}", node)
    task = asyncio.create_task(world.mirrors.run())
    await until(lambda: len(world.made) == 3)
    ways = {one.far.topic: one.way for one in world.mirrors if one.way is not None}
    clocks = [way._lateness for _, way in sorted(ways.items())]
    assert clocks[0] is clocks[1] is not clocks[2]
    world.mirrors.bus_removed("there")
    assert not world.mirrors._lateness
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await world.mirrors.close()
