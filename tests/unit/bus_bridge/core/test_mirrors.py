"""The order in which mirrors are made."""

import asyncio
from typing import Any
from unittest.mock import AsyncMock, Mock

from bus.qos import QoSProfile
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.far_graph import FarGraph
from bus_bridge.core.mirrors import Mirrors
from bus_bridge.core.naming import Naming
from bus_bridge.core.rules import Rules
from bus_bridge.engine import EndpointKind, FarBus, FarEndpoint, FarNode
from semantics import until

NODE = "client"


class World:
    """Mirrors of one far node. The mirror of a subscription on "/slow" is not made before `is_free`."""

    def __init__(self) -> None:
        self.far = FarGraph("here", Bounds(), Rules(), Naming(""))
        self.far.bus_added(FarBus("there"), 0.0)
        self.far.node_added(FarNode(NODE, "there", "client", "/"), 0.0)
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

    def add(self, kind: EndpointKind, topic: str) -> None:
        gid = len(self.far.endpoints).to_bytes(16, "big")
        endpoint = FarEndpoint(kind, gid, NODE, topic, "std_msgs/msg/String", "h", QoSProfile(10))
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


async def test_a_client_receives_answers_before_it_asks_however_late_it_comes() -> None:
    world = World()
    world.add("subscription", "/slow")
    task = asyncio.create_task(world.mirrors.run())
    await until(lambda: world.began == ["/slow"])
    world.add("subscription", "/replies")
    world.add("publisher", "/requests")
    world.is_free.set()
    await until(lambda: len(world.made) == 3)
    assert world.made == ["/slow", "/replies", "/requests"]
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await world.mirrors.close()
