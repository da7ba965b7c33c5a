"""The bus's services for bridges: mirrors of nodes and endpoints of other buses, and taps."""

import asyncio
import re
from pathlib import Path

import msgspec
import pytest

import bus
from bus.msg.std_msgs import String
from cli import bus as bus_cli
from conftest import WAIT_S, Daemon
from fake_broker import FakeBroker
from programs import running
from semantics import until

FAR = bus.Origin("zenoh", "laptop-1f2e3d4c")
FURTHER = bus.Origin("zenoh", "hub", via=("robot-1",))
GID = bytes(range(16))
BRIDGE = """
import asyncio, sys, bus
from bus.msg.std_msgs import String

async def main():
    origin = bus.Origin("zenoh", "laptop-1f2e3d4c")
    async with bus.Node("talker", origin=origin, arguments=[], rosout=False) as node:
        qos = bus.QoSProfile(10, durability="transient_local")
        publisher = await node.create_publisher(String, "t", qos, gid=bytes(range(16)))
        await publisher.wait_for_subscriptions()
        for number in range(int(sys.argv[1])):
            publisher.publish(String(data=f"{sys.argv[2]} {number}"))
        await publisher.flush()
        print("said", flush=True)
        await asyncio.Event().wait()

bus.run(main())
"""


def mirror_of(name: str, origin: bus.Origin = FAR) -> bus.Node:
    return bus.Node(name, origin=origin, arguments=[], rosout=False)


@pytest.mark.usefixtures("daemon", "route")
async def test_a_bridge_that_was_killed_and_is_back_is_heard(tmp_path: Path) -> None:
    """From its first message, although its gids are the same as before and its numbers restart at 1."""
    program = tmp_path / "bridge.py"
    program.write_text(BRIDGE)
    async with bus.Node("listener", arguments=[]) as node:
        qos = bus.QoSProfile(10, durability="transient_local")
        subscription = await node.create_subscription(String, "t", qos)
        for run in ("first", "second", "third"):
            async with running(tmp_path, program, "5", run) as bridge:
                heard = [await subscription.receive() for _ in range(5)]
                assert [message.data for message, _ in heard] == [f"{run} {number}" for number in range(5)]
                assert {info.publisher_gid for _, info in heard} == {GID}
                assert [one.gid for one in (await node.graph()).publishers_of("/t")] == [GID]
                late = await node.create_subscription(String, "t", qos)
                assert (await late.receive())[0].data == f"{run} 0"
                await late.close()
                bridge.process.kill()
            await until(lambda: not subscription.matches)
        totals = subscription.statistics()
        assert (totals.expected, totals.delivered, totals.dropped) == (15, 15, {})


@pytest.mark.usefixtures("daemon")
async def test_the_second_way_is_refused_in_one_sentence() -> None:
    async with mirror_of("talker") as one, mirror_of("talker", FURTHER) as other:
        await one.create_publisher(String, "t", gid=GID)
        with pytest.raises(bus.ConfigurationError) as caught:
            await other.create_publisher(String, "t", gid=GID)
        assert str(caught.value) == (
            f"gid {GID.hex()} is on this bus already: publisher of /talker on '/t', brought from "
            "laptop-1f2e3d4c by bridge zenoh"
        )


@pytest.mark.usefixtures("daemon", "route")
async def test_what_the_command_line_shows() -> None:
    async with (
        bus.Node("here", arguments=[], rosout=False) as here,
        mirror_of("far") as far,
        mirror_of("further", FURTHER) as further,
    ):
        await here.create_publisher(String, "t")
        publisher = await far.create_publisher(String, "t", gid=GID)
        mirror = await far.create_subscription(String, "t", gid=bytes(16), role="mirror")
        await further.create_subscription(String, "t", role="mirror", gid=b"f" * 16, local_only=True)
        tap = await further.create_subscription(String, "t", role="tap", local_only=True)
        await until(lambda: len(mirror.matches) == len(tap.matches) == 1)
        assert publisher.get_subscription_count() == 0
        mirror.report_besides(samples=7, bytes=700, dropped={"rate_limit": 2})
        said = await asyncio.to_thread(bus_cli, "node", "list")
        assert said.out == (
            "/far (from laptop-1f2e3d4c by zenoh)\n/further (from robot-1 through hub by zenoh)\n/here\n"
        )
        said = await asyncio.to_thread(bus_cli, "node", "list", "--json")
        records = [msgspec.json.decode(line) for line in said.out.splitlines()]
        assert [one.get("origin") for one in records] == [
            {"bridge": "zenoh", "bus": "laptop-1f2e3d4c"},
            {"bridge": "zenoh", "bus": "hub", "via": ["robot-1"]},
            None,
        ]
        said = await asyncio.to_thread(bus_cli, "node", "info", "/far")
        assert said.out.startswith("/far\n  Origin: from laptop-1f2e3d4c by zenoh\n  Subscribers:\n")
        said = await asyncio.to_thread(bus_cli, "topic", "info", "/t")
        assert said.out == "Type: std_msgs/msg/String\nPublisher count: 2\nSubscription count: 2\n"
        await until_told(here, mirror.gid, 7)
        said = await asyncio.to_thread(bus_cli, "topic", "info", "-v", "/t")
    blocks = said.out.split("\n\n")
    titles = [block for block in blocks if "count:" in block]
    assert titles == ["Publisher count: 2", "Subscription count: 2", "Tap count: 1"]
    by_node = {
        (lines_of(one)["Node name"], lines_of(one)["Endpoint type"]): one for one in blocks if "GID" in one
    }
    assert [*by_node] == [
        ("here", "PUBLISHER"),
        ("far", "PUBLISHER"),
        ("far", "SUBSCRIPTION"),
        ("further", "SUBSCRIPTION"),
        ("further", "TAP"),
    ]
    assert "Origin" not in by_node["here", "PUBLISHER"]
    assert "Origin: from robot-1 through hub by zenoh\n" in by_node["further", "TAP"]
    assert by_node["here", "PUBLISHER"].endswith(
        "Matches: 2\n  /far (route: bridge)\n  /further (route: bridge)"
    )
    assert by_node["far", "PUBLISHER"].endswith(
        "Matches: 0\n"
        "  /far (no match: both have come from laptop-1f2e3d4c)\n"
        "  /further (no match: both belong to other buses, and no bridge forwards between them here)"
    )
    assert (
        "Messages: 7 (700 B)\nQueue: 0 of 10\nDropped: 2 (rate_limit: 2)\nExpected: 9\n"
        in (by_node["far", "SUBSCRIPTION"])
    )
    assert re.search(r"Matches: 1\n  /here \(route: (shm|socket)\)$", by_node["further", "TAP"].rstrip())


def lines_of(block: str) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in block.splitlines() if ": " in line)


async def until_told(node: bus.Node, gid: bytes, samples: int) -> None:
    """Wait until the process of that endpoint has reported so many samples."""
    async with asyncio.timeout(10):
        while True:
            graph = await node.graph(statistics=True)
            (found,) = [one.statistics for one in graph.subscriptions if one.gid == gid]
            if found is not None and found.samples == samples:
                return
            await asyncio.sleep(0.01)


@pytest.mark.usefixtures("daemon")
async def test_a_thousand_endpoints_are_there() -> None:
    """That many are within the default limits of a program."""
    async with mirror_of("many") as node, asyncio.timeout(WAIT_S):
        made = await asyncio.gather(
            *(node.create_publisher(String, f"p{number}", gid=gid_of(number)) for number in range(500)),
            *(
                node.create_subscription(String, f"s{number}", gid=gid_of(500 + number), role="mirror")
                for number in range(500)
            ),
        )
        graph = await node.graph()
        assert {one.gid for one in (*graph.publishers, *graph.subscriptions)} == {one.gid for one in made}


def gid_of(number: int) -> bytes:
    return number.to_bytes(16, "big")


async def test_an_older_busd_is_told_apart(socket_path: Path) -> None:
    """An older busd would match mirrors with taps, and so return messages to their own bus."""
    async with asyncio.timeout(10), FakeBroker(socket_path) as broker:
        opening = asyncio.ensure_future(mirror_of("talker").open())
        await broker.accept()
        with pytest.raises(bus.ConfigurationError) as caught:
            await opening
    assert "it is older than this program; run: bus daemon restart" in str(caught.value)


async def test_busd_ends_and_a_new_one_knows_all(daemon: Daemon) -> None:
    async with mirror_of("far") as far, bus.Node("near", arguments=[]) as near:
        publisher = await near.create_publisher(String, "t")
        await far.create_subscription(String, "t", role="mirror", gid=GID)
        await publisher.wait_for_subscriptions()
        restarted = await asyncio.to_thread(bus_cli, "daemon", "restart")
        assert restarted.code == 0
        graph = await near.wait_for_graph(lambda graph: bool(graph.matches))
        assert [one.route for one in graph.matches] == ["bridge"]
        assert FAR in [one.origin for one in graph.nodes]
        assert daemon.process
