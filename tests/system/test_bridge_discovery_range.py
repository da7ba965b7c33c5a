"""`bus bridge ros2` with ROS 2's variables for discovery, and nodes of rclpy on two machines."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridged_world import Bridge, World, on_one_loop, until
from bus.graph import Graph
from bus.msg.std_msgs import String
from conftest import WAIT_S
from forks import Forks
from peers import peer
from peers.peer import Peer

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

_RANGE, _PEERS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"


@pytest.fixture(params=["cyclonedds", "rtps"])
def world(
    request: pytest.FixtureRequest, tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch
) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "laptop", "robot") as world:
        world.lay("laptop", "robot")
        world.carrier = request.param
        yield world


def bridge(world: World, *arguments: str) -> Bridge:
    options = ("--domain-id", str(world.domain), "--carrier", world.carrier)
    return world["laptop"].bridge("ros2", *options, *arguments)


async def ros(world: World, distro: peer.Distro, machine: str, reach: Any) -> Peer:
    """A node of rclpy, with the name of its machine."""
    return await asyncio.to_thread(
        peer.ros, distro, machine, world[machine].machine, domain=world.domain, reach=reach
    )


def names_in(graph: Graph) -> set[str]:
    return {node.full_name for node in graph.nodes}


async def logs(one: Bridge, text: str) -> None:
    await until(lambda: text in one.log.read_text(), lambda: one.log.read_text())


@peer.each_distro
@on_one_loop
async def test_localhost_finds_nodes_of_this_machine_and_static_peers(
    world: World, distro: peer.Distro, monkeypatch: pytest.MonkeyPatch
) -> None:
    cable = world.cable()
    monkeypatch.setenv(_RANGE, "LOCALHOST")
    first = bridge(world, "--interface", cable.interface_of("laptop"))
    await logs(first, f"{_RANGE} is LOCALHOST: no multicast, so other machines are found as peers only")
    with await ros(world, distro, "robot", "SUBNET"), await ros(world, distro, "laptop", "SUBNET") as witness:
        await asyncio.to_thread(witness.wait_for, "nodes", lambda found: "/robot" in found)
        await world["laptop"].shows(lambda graph: "/laptop" in names_in(graph))
        assert "/robot" not in world["laptop"].names()
        first.end()
        monkeypatch.setenv(_PEERS, f"{cable.address_of('robot')};")
        first.restart()
        await world["laptop"].shows(lambda graph: {"/laptop", "/robot"} <= names_in(graph))


@peer.each_distro
@on_one_loop
async def test_a_node_that_names_this_machine_as_a_peer_finds_the_bridge(
    world: World, distro: peer.Distro, monkeypatch: pytest.MonkeyPatch
) -> None:
    cable = world.cable()
    monkeypatch.setenv(_RANGE, "LOCALHOST")
    first = bridge(world, "--interface", cable.interface_of("laptop"))
    await logs(first, "no multicast")
    far = await asyncio.to_thread(
        peer.ros,
        distro,
        "robot",
        world["robot"].machine,
        domain=world.domain,
        reach="LOCALHOST",
        static_peers=cable.address_of("laptop"),
    )
    with far:
        await world["laptop"].shows(lambda graph: "/robot" in names_in(graph))


@peer.each_distro
@on_one_loop
async def test_off_finds_nothing(world: World, distro: peer.Distro, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(_RANGE, "OFF")
    monkeypatch.setenv(_PEERS, "127.0.0.1")
    async with world["laptop"].node("ours") as node:
        await node.create_publisher(String, "/chatter")
        first = bridge(world)
        await logs(first, f"{_RANGE} is OFF: the bridge finds no node of ROS 2, and none finds the bridge")
        await logs(first, f"{_RANGE} is OFF: {_PEERS} has no effect")
        with (
            await ros(world, distro, "laptop", "LOCALHOST") as one,
            await ros(world, distro, "laptop", "LOCALHOST") as two,
        ):
            for each in (one, two):
                await asyncio.to_thread(each.wait_for, "nodes", lambda found: found.count("/laptop") == 2)
            assert await asyncio.to_thread(one.ask, "nodes") == ["/laptop", "/laptop"]
            assert "/laptop" not in world["laptop"].names()


def test_a_wrong_value_ends_the_bridge_with_a_line(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(_RANGE, "SUBNETS")
    first = bridge(world)
    assert first.process.wait(WAIT_S) != 0
    (line,) = first.log.read_text().splitlines()
    assert line.endswith(f"{_RANGE} must be one of OFF, LOCALHOST, SUBNET, SYSTEM_DEFAULT, not 'SUBNETS'")
