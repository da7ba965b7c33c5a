"""`bus bridge ros2` as a client of a Discovery Server, with nodes of rclpy that are clients of the same."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridged_world import Bridge, World, on_one_loop, until
from bus.graph import Graph
from bus.msg.std_msgs import String
from bus.types.classes import service_class
from forks import Forks
from peers import peer
from peers.peer import Peer
from ports import free_port

_VARIABLE = "ROS_DISCOVERY_SERVER"
_STRING, _LIST = "std_msgs/msg/String", "rcl_interfaces/srv/ListParameters"
ListParameters: Any = service_class(_LIST)


@pytest.fixture
def world(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "laptop", "robot") as world:
        world.lay("laptop", "robot")
        yield world


class Place:
    """A Discovery Server on the machine `on`, at the address `host`, and the nodes that use it."""

    def __init__(self, world: World, distro: peer.Distro, folder: Path, on: str, host: str) -> None:
        self.world, self.distro, self._folder = world, distro, folder
        self._on, self._at = on, (host, free_port())
        self.address = f"{host}:{self._at[1]}"

    async def serve(self) -> Peer:
        machine = self.world[self._on].machine
        domain = self.world.domain
        return await asyncio.to_thread(
            peer.discovery_server, self.distro, machine, self._at, self._folder, domain=domain
        )

    async def node(self, name: str) -> Peer:
        """A node of rclpy on the machine of the server."""
        machine = self.world[self._on].machine
        return await asyncio.to_thread(
            peer.ros,
            self.distro,
            name,
            machine,
            domain=self.world.domain,
            reach="SUBNET",
            variables={_VARIABLE: self.address},
        )

    def bridge(self, *arguments: str) -> Bridge:
        return self.world["laptop"].bridge("ros2", "--domain-id", str(self.world.domain), *arguments)


def names_in(graph: Graph) -> set[str]:
    return {node.full_name for node in graph.nodes}


async def ask(far: Peer, order: str, **arguments: Any) -> Any:
    return await asyncio.to_thread(far.ask, order, **arguments)


@peer.each_distro
@on_one_loop
async def test_nodes_of_a_server(
    world: World, distro: peer.Distro, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Topics and services cross both ways; the bridge finds nodes that come, and loses those that go."""
    here = Place(world, distro, tmp_path, "laptop", "127.0.0.1")
    monkeypatch.setenv(_VARIABLE, here.address)
    side = world["laptop"]
    with await here.serve(), await here.node("robot") as robot:
        bridge = here.bridge()
        async with side.node("ours") as node:
            await side.shows(lambda graph: {"/robot", "/server"} <= names_in(graph))
            await ask(robot, "publish", topic="/theirs", type_name=_STRING, depth=100)
            await ask(robot, "listen", topic="/ours", type_name=_STRING, depth=100)
            subscription = await node.create_subscription(String, "/theirs", 100)
            publisher = await node.create_publisher(String, "/ours", 100)
            await subscription.wait_for_publishers()
            await publisher.wait_for_subscriptions()
            await asyncio.to_thread(robot.wait_for, "matched", lambda found: found[0], topic="/theirs")
            for number in range(100):
                await ask(robot, "send", topic="/theirs", data=f"{number}")
                publisher.publish(String(data=f"{number}"))
            heard = [(await subscription.receive())[0].data for _ in range(100)]
            assert heard == [f"{number}" for number in range(100)]
            assert [one["data"] for one in await asyncio.to_thread(robot.wait, "/ours", 100)] == heard

            await ask(robot, "offer", service="/theirs", type_name=_LIST, result={"names": ["a"]})
            client = await node.create_client(ListParameters, "/theirs")
            await client.wait_for_service()
            answers = await asyncio.gather(*[client.call(ListParameters.Request()) for _ in range(20)])
            assert [one.result.names for one in answers] == 20 * [["a"]]

            await node.create_service(ListParameters, "/ours", lambda request: ListParameters.Response())
            await asyncio.to_thread(
                robot.wait_for, "has_server", lambda found: found, service="/ours", type_name=_LIST
            )
            (found,) = await ask(robot, "call", service="/ours", type_name=_LIST)
            assert found["result"]["names"] == []

            with await here.node("second"):
                await side.shows(lambda graph: "/second" in names_in(graph))
            await side.shows(lambda graph: "/second" not in names_in(graph))
        said = bridge.log.read_text()
        assert f"nodes are found by Discovery Servers: {here.address}" in said
        assert "WARN" not in said


@peer.each_distro
@on_one_loop
async def test_a_server_that_dies_and_is_back(world: World, distro: peer.Distro, tmp_path: Path) -> None:
    """Nodes that know each other go on without it."""
    here = Place(world, distro, tmp_path, "laptop", "127.0.0.1")
    side = world["laptop"]
    here.bridge("--discovery-server", here.address)
    with await here.serve() as server, await here.node("robot") as robot:
        async with side.node("ours") as node:
            subscription = await node.create_subscription(String, "/theirs")
            await ask(robot, "publish", topic="/theirs", type_name=_STRING)
            await subscription.wait_for_publishers()
            await asyncio.to_thread(robot.wait_for, "matched", lambda found: found[0], topic="/theirs")
            await side.shows(lambda graph: "/server" in names_in(graph))
            server.kill()
            await side.shows(lambda graph: "/server" not in names_in(graph))
            await ask(robot, "send", topic="/theirs", data="without")
            assert (await subscription.receive())[0].data == "without"
            with await here.serve(), await here.node("second"):
                await side.shows(lambda graph: {"/robot", "/server", "/second"} <= names_in(graph))
                await ask(robot, "send", topic="/theirs", data="with")
                assert (await subscription.receive())[0].data == "with"


@peer.each_distro
@on_one_loop
async def test_a_server_that_restarts_at_once(world: World, distro: peer.Distro, tmp_path: Path) -> None:
    """It has the same GUID as before, and knows no client."""
    here = Place(world, distro, tmp_path, "laptop", "127.0.0.1")
    side = world["laptop"]
    here.bridge("--discovery-server", here.address)
    async with side.node("ours") as node:
        subscription = await node.create_subscription(String, "/theirs")
        with await here.serve() as server:
            await side.shows(lambda graph: "/server" in names_in(graph))
            server.kill()
        with await here.serve(), await here.node("second") as second:
            await side.shows(lambda graph: {"/server", "/second"} <= names_in(graph))
            await ask(second, "publish", topic="/theirs", type_name=_STRING)
            await subscription.wait_for_publishers()
            await asyncio.to_thread(second.wait_for, "matched", lambda found: found[0], topic="/theirs")
            await ask(second, "send", topic="/theirs", data="hello")
            assert (await subscription.receive())[0].data == "hello"


@peer.each_distro
@on_one_loop
async def test_a_server_on_another_machine(world: World, distro: peer.Distro, tmp_path: Path) -> None:
    cable = world.cable()
    there = Place(world, distro, tmp_path, "robot", cable.address_of("robot"))
    side = world["laptop"]
    there.bridge("--interface", cable.interface_of("laptop"), "--discovery-server", there.address)
    with await there.serve(), await there.node("robot") as robot:
        async with side.node("ours") as node:
            subscription = await node.create_subscription(String, "/theirs")
            await ask(robot, "publish", topic="/theirs", type_name=_STRING)
            await subscription.wait_for_publishers()
            await asyncio.to_thread(robot.wait_for, "matched", lambda found: found[0], topic="/theirs")
            await ask(robot, "send", topic="/theirs", data="from far")
            assert (await subscription.receive())[0].data == "from far"


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (
            ("--discovery-server", "robot:0"),
            "'robot:0' is not the address of a Discovery Server",
        ),
        (("--discovery-server", "10.0.0.2"), "10.0.0.2 can't be reached over the loopback interface"),
        (
            ("--discovery-server", "127.0.0.1", "--carrier", "cyclonedds"),
            "the Discovery Server 127.0.0.1 needs --carrier rtps: cyclonedds knows none",
        ),
        (("--rmw", "zenoh", "--discovery-server", "127.0.0.1"), "is an option of ROS 2 on dds: --rmw dds"),
    ],
)
def test_mistakes_are_told_in_a_line(world: World, options: tuple[str, ...], text: str) -> None:
    found = world["laptop"].bus("bridge", "ros2", *options)
    assert found.code == 1 and text in found.err and found.err.count("\n") <= 2, found


@on_one_loop
async def test_a_server_without_an_address_ends_the_bridge(world: World) -> None:
    interface = world.cable().interface_of("laptop")
    bridge = world["laptop"].bridge("ros2", "--interface", interface, "--discovery-server", "no.such.invalid")
    await until(lambda: bridge.process.poll() is not None)
    assert "no Discovery Server can be reached: no.such.invalid" in bridge.log.read_text()
