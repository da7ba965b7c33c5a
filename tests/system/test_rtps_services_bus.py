"""Services between a bus and ROS 2's rclpy, over our own RTPS: servers, clients, parameters and errors."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

import pytest

import bus
from bus.errors import ServiceError
from bus.names import reply_topic, request_topic
from bus.types.classes import service_class
from bus_bridge.dds.service_calls import CallsFromRos, CallsToRos
from bus_bridge.dds.service_types import ServiceTypes
from bus_bridge.dds.services import Services
from conftest import WAIT_S, Daemon
from peers import peer
from ports import own_domain

DOMAIN = own_domain()
DISTROS = pytest.mark.parametrize("distro", ["jazzy", "kilted"])
LIST = "rcl_interfaces/srv/ListParameters"
GET = "rcl_interfaces/srv/GetParameters"
SET = "rcl_interfaces/srv/SetParameters"
ListParameters: Any = service_class(LIST)


class Gateway:
    """What a bridge does with services: endpoints on the bus that stand for those of ROS 2."""

    def __init__(self, node: bus.Node) -> None:
        self.node = node
        self.warnings: list[str] = []
        self.services = Services(DOMAIN, self.warnings.append)
        self.ends: list[CallsFromRos | CallsToRos] = []
        self.tasks: list[asyncio.Task[None]] = []

    async def offer(self, service: str, type_name: str) -> CallsFromRos:
        """A service of the bus is there for ROS 2."""
        types = ServiceTypes.find(type_name)
        replies = await self.node.create_subscription(types.replies, reply_topic(service), 1000, raw=True)
        requests = await self.node.create_publisher(types.requests, request_topic(service), 1000)
        end = CallsFromRos(self.services, service, types, requests.gid, requests.publish_encoded)
        self.ends.append(end)

        async def take() -> None:
            async for payload in replies:
                end.reply(payload)

        self.tasks.append(asyncio.create_task(take()))
        return end

    async def bring(self, service: str, type_name: str) -> CallsToRos:
        """A service of ROS 2 is there for the bus."""
        types = ServiceTypes.find(type_name)
        replies = await self.node.create_publisher(types.replies, reply_topic(service), 1000)
        end = CallsToRos(self.services, service, types, replies.publish_encoded)
        self.ends.append(end)
        requests = await self.node.create_subscription(types.requests, request_topic(service), 1000, raw=True)

        async def take() -> None:
            async for payload in requests:
                end.request(payload)

        self.tasks.append(asyncio.create_task(take()))
        return end

    async def close(self) -> None:
        for end in self.ends:
            end.close()
        self.services.close()
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)


@pytest.fixture
async def gateway(daemon: Daemon) -> AsyncIterator[Gateway]:
    async with bus.Node("gateway", arguments=[]) as node:
        made = Gateway(node)
        yield made
        await made.close()


@pytest.fixture
async def node(daemon: Daemon) -> AsyncIterator[bus.Node]:
    async with bus.Node("robot", arguments=[]) as made:
        yield made


async def _ros(distro: peer.Distro) -> peer.Peer:
    return await asyncio.to_thread(peer.ros, distro, "ros_node", None, domain=DOMAIN)


async def _ask(ros: peer.Peer, order: str, **arguments: Any) -> Any:
    return await asyncio.to_thread(ros.ask, order, **arguments)


async def until(holds: Callable[[], object]) -> None:
    end = time.monotonic() + WAIT_S
    while not holds():
        assert time.monotonic() < end
        await asyncio.sleep(0.005)


def answer(request: Any) -> Any:
    response = ListParameters.Response()
    response.result.names = [*request.prefixes, str(request.depth)]
    return response


@DISTROS
async def test_rclpy_calls_a_server_of_the_bus(gateway: Gateway, node: bus.Node, distro: peer.Distro) -> None:
    def on_request(request: Any, request_id: bus.RequestId) -> None:
        server.respond(request_id, answer(request), "" if request.depth != 13 else "no thirteen")

    async with bus.Node("server", arguments=[]) as other:
        server = await other.create_service(ListParameters, "/ours", on_request=on_request)
        end = await gateway.offer("/ours", LIST)
        with await _ros(distro) as ros:
            call = {"service": "/ours", "type_name": LIST, "prefixes": ["grüß"], "depth": 5}
            (first,) = await _ask(ros, "call", **call)
            assert first["result"]["names"] == ["grüß", "5"]
            for _ in range(10):
                assert await _ask(ros, "call", **call, count=10) == 10 * [first]
            assert await _ask(ros, "call", **{**call, "depth": 13}, time_s=0.5) == [None]
            await until(lambda: end.failed == 1)
            assert "no thirteen" in gateway.warnings[0]
            assert end.waiting == end.server.waiting == 0


@DISTROS
async def test_the_bus_calls_a_server_of_rclpy(gateway: Gateway, node: bus.Node, distro: peer.Distro) -> None:
    end = await gateway.bring("/theirs", LIST)
    client = await node.create_client(ListParameters, "/theirs")
    with await _ros(distro) as ros:
        await _ask(ros, "offer", service="/theirs", type_name=LIST, result={"names": ["a"]})
        for _ in range(10):
            calls = [client.call(ListParameters.Request(depth=number)) for number in range(10)]
            found = await asyncio.wait_for(asyncio.gather(*calls), WAIT_S)
            assert [one.result.names for one in found] == 10 * [["a"]]
        heard = await asyncio.to_thread(ros.wait, "/theirs", 100)
        assert sorted(one["depth"] for one in heard) == sorted(10 * [*range(10)])
        await _ask(ros, "offer", service="/other", type_name=LIST, pause_s=100.0)
        await gateway.bring("/other", LIST)
        other = await node.create_client(ListParameters, "/other")
        task = asyncio.create_task(other.call(ListParameters.Request()))
        await asyncio.to_thread(ros.wait, "/other")
        await _ask(ros, "end", topic="/other")
        with pytest.raises(ServiceError, match="its server has gone"):
            await asyncio.wait_for(task, WAIT_S)
        ros.kill()
    assert (end.failed, end.waiting) == (0, 0)


@DISTROS
async def test_rclpy_sets_parameters_of_a_node_of_the_bus(
    gateway: Gateway, node: bus.Node, distro: peer.Distro
) -> None:
    await node.declare_parameter("speed", 3)
    for name, type_name in (("list_parameters", LIST), ("set_parameters", SET), ("get_parameters", GET)):
        await gateway.offer(f"/robot/{name}", type_name)
    with await _ros(distro) as ros:
        (found,) = await _ask(ros, "call", service="/robot/list_parameters", type_name=LIST)
        assert "speed" in found["result"]["names"]
        change = {"name": "speed", "value": {"type": 2, "integer_value": 9}}
        (found,) = await _ask(
            ros, "call", service="/robot/set_parameters", type_name=SET, parameters=[change]
        )
        assert [one["successful"] for one in found["results"]] == [True]
        (found,) = await _ask(
            ros, "call", service="/robot/get_parameters", type_name=GET, names=["speed", "use_sim_time"]
        )
        assert [(one["type"], one["integer_value"]) for one in found["values"]] == [(2, 9), (1, 0)]
    assert node.get_parameter("speed") == 9
