"""A bus, its bridge to ROS 2, and a node of rclpy: what the tests of `bus bridge ros2` share.

Tests import `world`, the fixture. It needs cyclonedds, which `make setup` installs.
"""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridged_world import Bridge, Side, World
from forks import Forks
from peers import peer
from peers.peer import Peer

__all__ = ["LIST", "ask", "join", "ros", "world"]

LIST = "rcl_interfaces/srv/ListParameters"
"""The service of most tests: each rclpy has it."""


@pytest.fixture
def world(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    """A bus with the name `robot`."""
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "robot") as world:
        yield world


def join(world: World, *arguments: str) -> tuple[Side, Bridge]:
    """The bus, with a bridge to ROS 2."""
    side = world["robot"]
    return side, side.bridge("ros2", "--domain-id", str(world.domain), "--carrier", world.carrier, *arguments)


async def ros(world: World, distro: peer.Distro) -> Peer:
    """A node of rclpy with the name `ros_node`."""
    machine = world["robot"].machine
    return await asyncio.to_thread(peer.ros, distro, "ros_node", machine, domain=world.domain)


async def ask(one: Peer, order: str, /, **arguments: Any) -> Any:
    """Does not block the nodes of this process."""
    return await asyncio.to_thread(one.ask, order, **arguments)
