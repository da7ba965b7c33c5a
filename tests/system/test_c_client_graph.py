"""The graph in the C client: the same as the library's, in one snapshot and while programs come and go."""

import asyncio
import json
import signal
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import bus
import c_programs
from bus.graph import Graph, GraphEndpoint
from bus.msg.std_msgs import Int32, String
from bus.srv.example_interfaces import AddTwoInts
from conftest import Daemon
from programs import Program, running_command
from semantics import LATCHED, node

__all__ = ["node"]

CHOICES = (
    ("history", ("keep_last", "keep_all")),
    ("reliability", ("reliable", "best_effort")),
    ("durability", ("volatile", "transient_local", "best_available")),
    ("liveliness", ("automatic", "manual_by_topic")),
)


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


def endpoint_in_c(one: GraphEndpoint) -> list[Any]:
    qos = one.qos
    choices = [values.index(getattr(qos, name)) for name, values in CHOICES]
    profile = [qos.depth, *choices, qos.deadline_ns, qos.lifespan_ns, qos.lease_ns]
    found = [one.id, one.node.id, one.topic, one.type_name, one.type_hash, one.gid.hex(), profile]
    if (s := one.statistics) is not None:
        counters = [s.samples, s.bytes, s.queued, s.expected, sum(s.dropped.values()), s.dropped]
        ages = [s.age_count, s.age_sum_ns, s.age_max_ns, s.most_missed, [*s.age_parts]]
        found.append([*counters, s.at_ns, *ages])
    return found


def ids(endpoints: Iterable[GraphEndpoint]) -> list[int]:
    return sorted(one.id for one in endpoints)


def graph_in_c(graph: Graph) -> dict[str, Any]:
    """The library's graph, as tests/c_client/graph.c prints it."""
    nodes = sorted(graph.nodes, key=lambda one: (one.full_name, one.id))

    def endpoints(found: Iterable[GraphEndpoint]) -> list[list[Any]]:
        return [endpoint_in_c(one) for one in sorted(found, key=lambda one: (one.topic, one.id))]

    return {
        "revision": graph.revision,
        "busd_pid": graph.broker_pid,
        "nodes": [
            [
                *(one.id, one.full_name, one.name, one.namespace, one.pid),
                *((one.origin.bridge, one.origin.bus) if one.origin else (None, None)),
            ]
            for one in nodes
        ],
        "publishers": endpoints(graph.publishers),
        "subscriptions": endpoints(graph.subscriptions),
        "taps": endpoints(graph.taps),
        "matches": sorted([one.publisher, one.subscription, one.route] for one in graph.matches),
        "topics": {
            name: [types, ids(graph.publishers_of(name)), ids(graph.subscriptions_of(name))]
            for name, types in graph.topics().items()
        },
        "services": {
            name: [types, ids(graph.servers_of(name)), ids(graph.clients_of(name))]
            for name, types in graph.services().items()
        },
    }


async def until_same(node: bus.Node, watching: Program) -> dict[str, Any]:
    """Wait until the watch in C has the library's graph of now; returns it."""
    wanted = graph_in_c(await node.graph())
    await watching.line(f'^{{"revision": {wanted["revision"]},')
    found: dict[str, Any] = json.loads(watching.lines[-1])
    assert found == wanted
    return found


async def test_one_snapshot_is_the_librarys(node: bus.Node, programs: Path, tmp_path: Path) -> None:
    profile = bus.QoSProfile(
        7,
        durability="transient_local",
        deadline=0.1,
        lifespan=2.5,
        liveliness="manual_by_topic",
        liveliness_lease_duration=1e-9,
    )
    await node.create_publisher(String, "/all", profile)
    await node.create_subscription(String, "/all", bus.QoSProfile(3, durability="best_available"))
    await node.create_subscription(Int32, "/all", 10)
    await node.create_service(AddTwoInts, "/add", lambda _: AddTwoInts.Response())
    await node.create_client(AddTwoInts, "/add")
    await node.create_client(AddTwoInts, "/alone/add")
    async with bus.Node("other", namespace="/deep/down") as other:
        await other.create_subscription(String, "/add/_request", 10)  # no server
        wanted = graph_in_c(await node.graph())
        async with running_command(tmp_path, programs / "graph", "get") as program:
            assert await program.end() == 0, program.lines
    assert json.loads(program.lines[0]) == wanted
    assert wanted["topics"]["/all"][0] == ["std_msgs/msg/Int32", "std_msgs/msg/String"]
    assert [len(part) for part in wanted["services"]["/add"]] == [2, 1, 1]
    assert [len(part) for part in wanted["services"]["/alone/add"]] == [1, 0, 1]
    assert len(wanted["matches"]) == 3


async def test_a_snapshot_with_statistics_is_the_librarys(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    subscription = await node.create_subscription(String, "/t", 2)
    async with c_programs.peer(programs, tmp_path, "talk", "/t", "9", "wait=1") as talker:
        await talker.line("published")
        while (await subscription.receive())[0].data != "8 ":
            pass
        async with asyncio.timeout(10):  # until both processes have reported, and nothing changes meanwhile
            while True:
                wanted = graph_in_c(await node.graph(statistics=True))
                async with running_command(tmp_path, programs / "graph", "counted") as program:
                    assert await program.end() == 0, program.lines
                samples = [
                    one[7][0] for one in (*wanted["publishers"], *wanted["subscriptions"]) if one[2] == "/t"
                ]
                dropped = wanted["subscriptions"][0][7][4]
                is_complete = samples == [9, 9 - dropped]
                if is_complete and graph_in_c(await node.graph(statistics=True)) == wanted:
                    break
        await talker.finish()
    assert json.loads(program.lines[0]) == wanted
    assert wanted["subscriptions"][0][7][-1]  # a histogram of ages


async def test_a_watch_follows_programs_that_come_and_go(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    async with running_command(tmp_path, programs / "graph", "watch") as watching:
        await until_same(node, watching)
        subscription = await node.create_subscription(String, "/t", LATCHED)
        await until_same(node, watching)
        async with c_programs.peer(programs, tmp_path, "talk", "/t", "1", "latched", "wait=1") as talker:
            await subscription.receive()
            found = await until_same(node, watching)
            assert [one[2] for one in found["matches"]] == [route]
            talker.program.process.send_signal(signal.SIGKILL)
            await talker.program.end()
        await node.wait_for_graph(lambda graph: not graph.publishers_of("/t"))
        assert (await until_same(node, watching))["matches"] == []
        nodes = [bus.Node(f"many_{number}") for number in range(20)]
        await asyncio.gather(*(one.open() for one in nodes))
        for one in nodes:
            await one.create_publisher(String, f"/{one.name}", 1)
        assert len((await until_same(node, watching))["nodes"]) == 21
        await asyncio.gather(*(one.close() for one in nodes))
        assert len((await until_same(node, watching))["nodes"]) == 1
        watching.process.send_signal(signal.SIGTERM)
        assert await watching.end() == 0


async def test_a_watch_continues_after_a_kill_of_busd(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    await node.create_publisher(String, "/t", 10)
    async with running_command(tmp_path, programs / "graph", "watch") as watching:
        before = await until_same(node, watching)
        daemon.kill()
        daemon.restart()
        await node.wait_for_graph(lambda graph: bool(graph.publishers_of("/t")))
        await watching.line(f'"busd_pid": {(await node.graph()).broker_pid},')
        await node.create_publisher(String, "/new", 10)
        found = await until_same(node, watching)
        watching.process.send_signal(signal.SIGTERM)
        assert await watching.end() == 0
    assert found["busd_pid"] != before["busd_pid"]
    assert [one[2] for one in found["publishers"]] == ["/new", "/rosout", "/t"]


async def test_watches_begin_and_end_in_callbacks(daemon: Daemon, programs: Path, tmp_path: Path) -> None:
    async with running_command(tmp_path, programs / "graph", "story") as program:
        assert await program.end() == 0, program.lines
    assert program.lines == [
        "second: 1",
        "wait in a callback: 1",
        *["calls 1 and 1"] * 2,
        "kept 0 nodes",
        "topic 0, service 0",
    ]


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
async def test_the_graph_in_cpp(node: bus.Node, programs: Path, tmp_path: Path) -> None:
    await node.create_publisher(String, "/t", 10)
    async with running_command(tmp_path, programs / "graph_cpp") as program:
        await program.line("^watched /tester | /t std_msgs/msg/String from tester$")
        await node.create_service(AddTwoInts, "/add", lambda _: AddTwoInts.Response())
        await program.line("^watched /tester .* service /add$")
        program.process.send_signal(signal.SIGTERM)
        assert await program.end() == 0, program.lines
    now, once, kept, none = program.lines[-4:]
    assert now.removeprefix("now ") == kept.removeprefix("kept ")
    assert (once, none) == ("once 1", "0 0")
