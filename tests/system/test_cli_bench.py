"""`bus bench` with real processes, on the running bus or its own: good, lossy, interrupted, broken."""

import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from bus import shm
from bus.graph import Graph
from bus.msg.std_msgs import String
from bus.node import Node
from cli import Result, bus, start
from programs import on_one_loop

pytestmark = pytest.mark.landing

FEW = ("--count", "50", "--warm-up", "0.02")
LONG = ("--seconds", "600", "--warm-up", "0")


def record(result: Result) -> dict[str, Any]:
    assert result.err == ""
    found: dict[str, Any] = msgspec.json.decode(result.out)
    return found


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


@asynccontextmanager
async def watched() -> AsyncIterator[tuple[Node, Graph]]:
    """A node, and a graph in which all processes of a bench run and it has begun."""

    def has_begun(graph: Graph) -> bool:
        return any(one.topic.startswith("/_bench/") for one in graph.publishers) and bool(graph.matches)

    async with Node("watcher", arguments=(), rosout=False) as node:
        yield node, await node.wait_for_graph(has_begun)


async def hear_one(node: Node, graph: Graph) -> None:
    """Wait for the first message of the bench."""
    topic = next(one.topic for one in graph.publishers if one.topic.startswith("/_bench/"))
    subscription = await node.create_subscription(String, topic)
    await subscription.receive()


def pids_of(graph: Graph) -> dict[str, int]:
    """The pids of the bench's processes, by role."""
    workers = [node for node in graph.nodes if node.name.startswith("_bench_")]
    return {node.name.split("_")[2]: node.pid for node in workers}


def test_latency_on_the_bus_that_runs(daemon: Any) -> None:
    result = bus("bench", "latency", "--size", "64,1KiB", *FEW, is_fresh=True)
    assert (result.err, result.code) == ("", 0)
    first, second, _, *rest = result.out.splitlines()
    assert first == "std_msgs/msg/String, 1 publisher, 1 subscriber, reliable + keep all"
    assert second == f"on the busd at {daemon.path} (pid {daemon.pid})"
    assert [line.split()[:4] for line in rest if line.startswith(("64 B", "1 KiB"))] == [
        ["64", "B", "1,000/s", "shm" if shm.is_available() else "socket"],
        ["1", "KiB", "1,000/s", "shm" if shm.is_available() else "socket"],
        *(["64", "B", "1,000/s", since] for since in ("sent", "due")),
        *(["1", "KiB", "1,000/s", since] for since in ("sent", "due")),
    ]
    assert bus("node", "list", "-a").out == ""


def test_fanout_in_json_on_a_bus_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_SOCKET", str(tmp_path / "none.sock"))
    monkeypatch.setenv("BUSD_AUTOSTART", "1")
    result = bus("bench", "fanout", "--json", "--subscribers", "2", "--type", "bytes", *FEW)
    found = record(result)
    assert result.code == 0
    assert found["bus"]["own"] is True
    assert not alive(found["bus"]["pid"])
    assert not Path(found["bus"]["socket"]).parent.exists()
    assert (found["verb"], found["type"]) == ("fanout", "std_msgs/msg/UInt8MultiArray")
    assert (found["publishers"], found["subscribers"], found["interrupted"]) == (1, 2, False)
    flood, paced = found["runs"]
    assert (flood["rate"], paced["rate"]) == (None, 1000.0)
    for run in (flood, paced):
        assert (run["published"], run["expected"], run["delivered"]) == (50, 100, 100)
        assert (run["dropped"], run["unaccounted"]) == ({}, 0)
    assert paced["since_sent_us"]["samples"] == paced["since_due_us"]["samples"] == 100
    assert paced["last_us"]["samples"] == 50
    assert paced["last_us"]["max"] == paced["since_sent_us"]["max"]
    assert flood["since_due_us"] is None


def test_two_at_once_do_not_hear_each_other(daemon: object) -> None:
    """One of them uses the socket, and runs as fast as possible."""
    words = ("--publishers", "2", "--route", "socket", "--count", "2000")
    with (
        start("bench", "throughput", "--json", *words) as flood,
        start("bench", "latency", "--json", *FEW) as paced,
    ):
        by_socket, other = record(flood.end())["runs"][0], record(paced.end())["runs"][0]
    assert by_socket["route"] == "socket"
    assert by_socket["published"] == by_socket["delivered"] == 4000
    assert other["published"] == other["delivered"] == other["since_sent_us"]["samples"] == 50


def test_what_best_effort_loses_is_counted_and_no_error(daemon: object) -> None:
    words = ("--qos-reliability", "best_effort", "--qos-depth", "1", "--size", "64KiB")
    result = bus("bench", "throughput", "--json", *words, "--count", "2000")
    run = record(result)["runs"][0]
    assert result.code == 0
    assert run["delivered"] + sum(run["dropped"].values()) == run["expected"] == 2000
    assert run["unaccounted"] == 0


@on_one_loop
async def test_ctrl_c_ends_it_with_what_was_measured(daemon: object) -> None:
    with start("bench", "latency", "--json", *LONG) as running:
        async with watched() as (node, graph):
            await hear_one(node, graph)
            result = running.end(signal.SIGINT)
        pids = pids_of(graph)
    assert (result.code, result.err) == (-signal.SIGINT, "interrupted: this is what was measured so far\n")
    found = msgspec.json.decode(result.out)
    assert found["interrupted"] is True
    run = found["runs"][0]
    assert 0 < run["published"] == run["delivered"]
    assert len(pids) == 2
    assert not any(map(alive, pids.values()))


@on_one_loop
async def test_a_worker_that_is_killed_is_told(daemon: object) -> None:
    with start("bench", "throughput", *LONG) as running:
        async with watched() as (node, graph):
            await hear_one(node, graph)
            pids = pids_of(graph)
            os.kill(pids["subscriber"], signal.SIGKILL)
            result = running.end()
    assert result.code == 1
    assert result.err == f"subscriber 1 (pid {pids['subscriber']}) was ended by SIGKILL\n"
    assert not any(map(alive, pids.values()))


@pytest.mark.parametrize("settings", ["[limits]\nmessage_bytes = 4096\n"])
def test_sizes_above_the_limit_of_this_bus(daemon: object) -> None:
    result = bus("bench", "latency", "--size", "5000", *FEW)
    assert result.code == 1
    assert result.err.startswith("--size 5000: that is a message of ")
    assert "busd's limit is 4096 B" in result.err


def test_a_route_that_cannot_be(daemon: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_NATIVE", "no")
    result = bus("bench", "latency", "--route", "shm", *FEW)
    assert result.code == 1
    assert result.err == "--route shm: messages would go by socket: BUS_NATIVE=no is set\n"


def test_no_bus_and_none_may_be_started(socket_path: Path) -> None:
    result = bus("bench", "latency", *FEW)
    assert result.code == 1
    assert result.err.startswith(f"no busd listens on {socket_path}, and BUSD_AUTOSTART=0 keeps")
