"""Calls between a bus and ROS 2's rclpy while a server, a client, the bridge or busd dies.

Each call on the bus ends, and no server carries one out twice.
"""

import asyncio
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import bus
from bridged_world import Bridge, World, on_one_loop, until
from bus.types.classes import service_class
from peers import peer
from peers.peer import Peer
from ros2_bridged import LIST, ask, join, ros, world

__all__ = ["world"]

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

ListParameters: Any = service_class(LIST)
LEASE_S = 28.0
"""Longer than the lease of a participant of ROS 2."""
SOON_S = 5.0
ONCE = dict.fromkeys(range(20), 1)


def begin(client: Any, count: int) -> list[asyncio.Task[Any]]:
    return [asyncio.create_task(client.call(ListParameters.Request(depth=number))) for number in range(count)]


async def ends(calls: list[asyncio.Task[Any]], within_s: float) -> Counter[str]:
    """How the calls end."""
    async with asyncio.timeout(within_s):
        found = await asyncio.gather(*calls, return_exceptions=True)
    assert all(isinstance(one, bus.BusError) for one in found if isinstance(one, BaseException)), found
    return Counter(type(one).__name__ if isinstance(one, BaseException) else "answer" for one in found)


def depths(far: Peer) -> Counter[int]:
    """The numbers of the requests that `far` has received."""
    return Counter(one["depth"] for one in far.heard["/theirs"])


def descriptors(bridge: Bridge) -> int:
    return len(list(Path(f"/proc/{bridge.process.pid}/fd").iterdir()))


class Asked:
    """A server on the bus that answers later, and a client of rclpy that asks it eight times."""

    def __init__(self) -> None:
        self.requests: list[bus.RequestId] = []

    def on_request(self, request: Any, request_id: bus.RequestId) -> None:
        self.requests.append(request_id)

    async def by(self, far: Peer, time_s: float = 10.0) -> asyncio.Task[Any]:
        """The answers that `far` gets, once its eight requests have arrived."""
        call = ask(far, "call", service="/ours", type_name=LIST, count=8, time_s=time_s)
        task = asyncio.create_task(call)
        await until(lambda: len(self.requests) == 8)
        return task

    def answer(self, server: Any) -> None:
        for one in self.requests:
            server.respond(one, ListParameters.Response())


@peer.each_distro
@on_one_loop
async def test_a_slow_server_loses_no_request(world: World, distro: peer.Distro) -> None:
    """Its queue of ten is shared by all clients."""
    side, _ = join(world)
    async with side.node("one") as one, side.node("other") as other:
        clients = [await node.create_client(ListParameters, "/theirs") for node in (one, other)]
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, pause_s=0.05)
            for client in clients:
                await client.wait_for_service()
            calls = [*begin(clients[0], 20), *begin(clients[1], 20)]
            assert await ends(calls, LEASE_S) == {"answer": 40}


@peer.each_distro
@on_one_loop
async def test_two_servers_carry_out_each_request_once(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    heard: list[int] = []

    def on_request(request: Any) -> Any:
        heard.append(request.depth)
        return ListParameters.Response()

    async with side.node("one") as one, side.node("other") as other:
        for node in (one, other):
            await node.create_service(ListParameters, "/ours", on_request)
        with await ros(world, distro) as far:
            await until(lambda: far.ask("servers", service="/ours") == 2)
            for depth in range(5):
                (found,) = await ask(far, "call", service="/ours", type_name=LIST, depth=depth)
                assert found is not None
        await until(lambda: len(heard) >= 10)
        assert Counter(heard) == dict.fromkeys(range(5), 2)


@pytest.mark.nightly
@peer.each_distro
@on_one_loop
async def test_a_server_of_rclpy_is_killed(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    async with side.node("client") as node:
        client = await node.create_client(ListParameters, "/theirs")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, pause_s=100.0)
            await client.wait_for_service()
            calls = begin(client, 100)
            await asyncio.to_thread(far.wait, "/theirs")
            far.kill()
            assert await ends(calls, LEASE_S) == {"ServiceUnavailable": 100}
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST)
            await client.wait_for_service()
            assert await ends(begin(client, 10), SOON_S) == {"answer": 10}


@pytest.mark.nightly
@peer.each_distro
@on_one_loop
async def test_a_client_of_rclpy_is_killed(world: World, distro: peer.Distro) -> None:
    side, bridge = join(world)
    asked, before = Asked(), 0
    async with side.node("server") as node:
        server = await node.create_service(ListParameters, "/ours", on_request=asked.on_request)
        for _ in range(2):
            with await ros(world, distro) as far:
                call = await asked.by(far)
                far.kill()
                with pytest.raises(TimeoutError):
                    await call
            asked.answer(server)
            asked.requests.clear()
            await until(lambda: "/ros_node" not in side.names(), within_s=LEASE_S)
            assert descriptors(bridge) <= (before or descriptors(bridge))
            before = descriptors(bridge)


@pytest.mark.nightly
@peer.each_distro
@on_one_loop
async def test_the_bridge_is_killed(world: World, distro: peer.Distro) -> None:
    side, bridge = join(world)
    async with side.node("both") as node:
        client = await node.create_client(ListParameters, "/theirs")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, pause_s=0.1)
            asked = Asked()
            server = await node.create_service(ListParameters, "/ours", on_request=asked.on_request)
            await client.wait_for_service()
            calls, answers = begin(client, 20), await asked.by(far, 2.0)
            await asyncio.to_thread(far.wait, "/theirs", 2)
            bridge.kill()
            assert (await ends(calls, SOON_S))["ServiceUnavailable"] >= 12
            bridge.restart()
            asked.answer(server)
            assert await answers == 8 * [None]  # as ROS 2 has it: its client knows of no end
            await client.wait_for_service()
            assert max(depths(far).values()) == 1
            assert await ends(begin(client, 10), SOON_S) == {"answer": 10}
            assert len(asked.requests) == 8


@pytest.mark.nightly
@peer.each_distro
@on_one_loop
async def test_busd_is_killed(world: World, distro: peer.Distro) -> None:
    side, _ = join(world)
    async with side.node("both") as node:
        client = await node.create_client(ListParameters, "/theirs")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, pause_s=0.05)
            for answers_meanwhile in (False, True):
                asked = Asked()
                server = await node.create_service(ListParameters, "/ours", on_request=asked.on_request)
                await client.wait_for_service()
                far.heard.clear()
                calls, answers = begin(client, 20), await asked.by(far)
                await asyncio.to_thread(far.wait, "/theirs", 2)
                side.daemon.kill()
                if answers_meanwhile:
                    asked.answer(server)
                side.daemon.restart()
                assert (await ends(calls, SOON_S)).total() == 20
                if not answers_meanwhile:
                    asked.answer(server)
                assert None not in await answers
                assert depths(far) == ONCE and len(asked.requests) == 8
                await server.close()


@peer.each_distro
@on_one_loop
async def test_ctrl_c_ends_open_calls(world: World, distro: peer.Distro) -> None:
    side, bridge = join(world)
    async with side.node("client") as node:
        client = await node.create_client(ListParameters, "/theirs")
        with await ros(world, distro) as far:
            await ask(far, "offer", service="/theirs", type_name=LIST, pause_s=100.0)
            await client.wait_for_service()
            calls = begin(client, 100)
            await asyncio.to_thread(far.wait, "/theirs")
            bridge.end()
            bridge.is_killed = True
            assert await ends(calls, SOON_S) == {"ServiceUnavailable": 100}
            assert "WARN" not in bridge.log.read_text()
            far.kill()
