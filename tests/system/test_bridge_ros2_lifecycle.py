"""Lifecycle nodes between a bus and ROS 2's rclpy, through `bus bridge ros2`."""

import asyncio
from typing import Any

import pytest

from bridged_world import World, on_one_loop, until
from cli import script
from peers import peer
from ros2_bridged import join, ros, world

__all__ = ["world"]

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

NODE = """
import bus.rclpy_compat
import rclpy
from rclpy.lifecycle import LifecycleNode

rclpy.init()
node = LifecycleNode("managed")
print("ready", flush=True)
rclpy.spin(node)
"""
SRV = "lifecycle_msgs/srv"


@peer.each_distro
@on_one_loop
async def test_the_bus_manages_a_node_of_rclpy(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    with await ros(world, distro) as far:
        await asyncio.to_thread(far.ask, "manage", name="managed")
        await until(lambda: side.bus("lifecycle", "get", "/managed").out == "unconfigured [1]\n")
        assert side.bus("lifecycle", "nodes").out == "/managed\n"
        listed = side.bus("lifecycle", "list", "/managed").out
        assert "configure [1]" in listed and "shutdown [5]" in listed and "activate" not in listed
        assert side.bus("lifecycle", "set", "/managed", "configure").out == "Transitioning successful\n"
        assert side.bus("lifecycle", "set", "/managed", "activate").err == "Transitioning failed\n"
        assert side.bus("lifecycle", "set", "/managed", "activate").out == "Transitioning successful\n"
        assert side.bus("lifecycle", "get", "/managed").out == "active [3]\n"
        assert far.heard["managed"] == ["configure", "activate", "activate"]


@peer.each_distro
@on_one_loop
async def test_rclpy_manages_a_node_of_the_bus(
    world: World, distro: peer.Distro, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BUSD_SOCKET", str(world["robot"].path))
    join(world)
    with script(NODE), await ros(world, distro) as far:

        def call(name: str, kind: str, **request: Any) -> Any:
            arguments = {"service": f"/managed/{name}", "type_name": f"{SRV}/{kind}", **request}
            return far.ask("call", **arguments)[0]

        async def ask(name: str, kind: str, **request: Any) -> Any:
            return await asyncio.to_thread(call, name, kind, **request)

        assert (await ask("get_state", "GetState"))["current_state"]["label"] == "unconfigured"
        found = await ask("get_available_transitions", "GetAvailableTransitions")
        assert {one["transition"]["label"] for one in found["available_transitions"]} == {
            "configure",
            "shutdown",
        }
        assert (await ask("change_state", "ChangeState", transition={"id": 1}))["success"]
        assert not (await ask("change_state", "ChangeState", transition={"id": 1}))["success"]
        assert (await ask("change_state", "ChangeState", transition={"label": "activate"}))["success"]
        assert (await ask("get_state", "GetState"))["current_state"] == {"id": 3, "label": "active"}
