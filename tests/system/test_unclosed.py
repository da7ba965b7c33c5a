"""Nodes that a program never closes: it gets a warning, and dropped nodes are closed."""

import asyncio
import gc
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import uvloop

import bus
from bus.logger import LogEntry
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Empty
from bus_cli.query import Query
from conftest import WAIT_S, Daemon
from neighbours import wait_until

LOOPS = pytest.mark.parametrize("new_loop", [asyncio.new_event_loop, uvloop.new_event_loop])
CLOSED = r"node /cell was never closed: use async with, or await its close\(\)"


@pytest.fixture
def told() -> Iterator[list[str]]:
    """The library's log."""
    texts: list[str] = []

    def sink(entry: LogEntry) -> None:
        texts.append(entry.text)

    log = bus.get_logger("bus")
    log.add_sink(sink)
    yield texts
    log.remove_sink(sink)


def nodes(daemon: Daemon) -> list[str]:
    with Query(daemon.path) as query:
        return [node.name for node in query.graph().nodes if not node.name.startswith("_")]


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208


async def cell() -> bus.Node:
    """A node with one object of each kind; all refer to the node, and have work to do."""
    node = bus.Node("cell", arguments=[])
    await node.open()
    heard = asyncio.Event()

    async def hear(message: String) -> None:
        node.statistics()
        heard.set()

    await node.create_subscription(String, "t", 10, lambda message: node.statistics())
    await node.create_subscription(String, "t", 10, hear)
    await node.create_service(Empty, "s", lambda request: Empty.Response() if node else None)
    await node.declare_parameter("x", 1)
    client = await node.create_client(Empty, "s")
    publisher = await node.create_publisher(String, "t")
    publisher.publish(String())
    await client.call(Empty.Request())
    await heard.wait()
    return node


def run(new_loop: Callable[[], asyncio.AbstractEventLoop]) -> bus.Node:
    with asyncio.Runner(loop_factory=new_loop) as runner:
        return runner.run(cell())


def line_of_cell() -> int:
    return cell.__code__.co_firstlineno + 2


@LOOPS
def test_whose_event_loop_has_ended(
    daemon: Daemon, route: str, new_loop: Callable[[], asyncio.AbstractEventLoop]
) -> None:
    with pytest.warns(ResourceWarning) as warned:
        run(new_loop)
        gc.collect()
        before = descriptors()
        for _ in range(2):
            run(new_loop)
            gc.collect()
    assert [re.fullmatch(CLOSED, str(one.message)) is not None for one in warned] == [True] * 3
    assert {(one.filename, one.lineno) for one in warned} == {(__file__, line_of_cell())}
    assert descriptors() == before
    wait_until(lambda: not nodes(daemon))


@LOOPS
def test_while_the_event_loop_runs(
    daemon: Daemon, route: str, new_loop: Callable[[], asyncio.AbstractEventLoop], told: list[str]
) -> None:
    """A notebook runs its cell once more; the garbage collector runs in another thread."""

    async def cells() -> None:
        await cell()
        await asyncio.sleep(0.6)  # counters are reported by then, and held until then
        other = bus.Node("other", arguments=[])
        await other.open()
        await asyncio.to_thread(gc.collect)
        while [one.name for one in (await other.graph()).nodes] != ["other"]:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        await other.close()

    with pytest.warns(ResourceWarning, match=CLOSED), asyncio.Runner(loop_factory=new_loop) as runner:
        runner.run(asyncio.wait_for(cells(), WAIT_S))
    (text,) = [one for one in told if "is closed now" in one]
    assert text.startswith(f"node /cell, made at {__file__}:{line_of_cell()}, is closed now, because")


@LOOPS
def test_is_closed_after_the_collection(
    daemon: Daemon, route: str, new_loop: Callable[[], asyncio.AbstractEventLoop], told: list[str]
) -> None:
    """Otherwise the loop cancels tasks while the collector, in another thread, closes their coroutines."""
    seen: list[list[str]] = []

    class Neighbour:
        """Found together with the node. The event loop has a turn before the collection goes on."""

        def __init__(self) -> None:
            self.loop = asyncio.get_running_loop()

        def __del__(self) -> None:
            had_turn = threading.Event()
            self.loop.call_soon_threadsafe(had_turn.set)
            assert had_turn.wait(WAIT_S)
            seen.append([one for one in told if "is closed now" in one])

    async def listener() -> None:
        node = bus.Node("cell", arguments=[])
        await node.open()
        neighbours = [Neighbour()]

        async def hear(message: String) -> None:
            node.statistics()
            neighbours.clear()

        await node.create_subscription(String, "t", 10, hear)
        neighbours.append(Neighbour())

    async def cells() -> None:
        await listener()
        await asyncio.sleep(0.6)  # counters are reported by then, and held until then
        await asyncio.to_thread(gc.collect)
        while not [one for one in told if "is closed now" in one]:  # noqa: ASYNC110
            await asyncio.sleep(0.01)

    gc.disable()  # a collection by the event loop's own thread would keep it from having a turn
    try:
        with pytest.warns(ResourceWarning, match=CLOSED), asyncio.Runner(loop_factory=new_loop) as runner:
            runner.run(asyncio.wait_for(cells(), WAIT_S))
    finally:
        gc.enable()
    assert seen == [[], []]


async def test_endpoints_keep_their_node(daemon: Daemon) -> None:
    async def listener(heard: asyncio.Event) -> bus.Subscription[Any]:
        node = bus.Node("listener", arguments=[])
        await node.open()
        return await node.create_subscription(String, "t", 10, lambda message: heard.set())

    heard = asyncio.Event()
    subscription = await listener(heard)
    gc.collect()
    async with asyncio.timeout(WAIT_S), bus.Node("talker", arguments=[]) as node:
        publisher = await node.create_publisher(String, "t")
        publisher.publish(String())
        await heard.wait()
    del publisher, node
    assert subscription.matches == () or subscription.statistics().delivered == 1
    subscription._core.on_error.__self__._reminder.must_be_closed = False  # type: ignore[attr-defined]


async def test_in_its_async_with_a_node_stays(daemon: Daemon) -> None:
    """Even if only an unreferenced task refers to it."""
    done = asyncio.Event()

    async def listen() -> None:
        async with bus.Node("listener", arguments=[]) as node:
            async for _ in await node.create_subscription(String, "t", 10):
                break
        done.set()

    asyncio.create_task(listen())
    async with asyncio.timeout(WAIT_S), bus.Node("talker", arguments=[]) as node:
        publisher = await node.create_publisher(String, "t")
        await publisher.wait_for_subscriptions()
        gc.collect()
        publisher.publish(String())
        await done.wait()


def test_of_the_same_name(daemon: Daemon, told: list[str]) -> None:
    """The first node still exists, but its event loop does not: one warning."""
    kept = [run(asyncio.new_event_loop) for _ in range(3)]
    assert told == [
        f"this process has another open node named /cell, made at {__file__}:{line_of_cell()}: "
        "close it first, or choose another name"
    ]
    with pytest.warns(ResourceWarning, match=CLOSED):
        kept.clear()
        gc.collect()


def script() -> "bus.BlockingPublisher[String]":
    node = bus.connect("script", arguments=[])
    node.publish("t", String())
    return node.create_publisher(String, "u")


def test_of_a_script(daemon: Daemon, route: str) -> None:
    with pytest.warns(ResourceWarning, match=r"use with bus.connect\(...\), or its close\(\)") as warned:
        publisher = script()
        gc.collect()
    (one,) = warned
    assert (one.filename, one.lineno) == (__file__, script.__code__.co_firstlineno + 1)
    del one, warned  # they hold the node
    assert nodes(daemon) == ["script"]
    assert publisher.matches == ()  # it keeps its node
    del publisher
    gc.collect()
    wait_until(lambda: not nodes(daemon))


def test_of_a_script_dropped_in_another_thread(daemon: Daemon) -> None:
    """Only the thread that connected may close it: its next call does so."""
    with pytest.warns(ResourceWarning, match="node /script was never closed"):
        script()
    node = bus.connect("next", arguments=[])
    collecting = threading.Thread(target=gc.collect)
    collecting.start()
    collecting.join()
    node.publish("t", String())
    wait_until(lambda: nodes(daemon) == ["next"])
    node.close()


def test_warnings_as_errors(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python reports them as errors in the finalizer, and the node is still closed."""
    reported: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda report: reported.append(report.exc_value))
    run(asyncio.new_event_loop)
    gc.collect()
    assert [type(one) for one in reported] == [ResourceWarning]
    reported.clear()
    wait_until(lambda: not nodes(daemon))


@pytest.mark.parametrize("how", ["asyncio.run(main())", "bus.run(main())"])
def test_at_the_end_of_the_program(daemon: Daemon, tmp_path: Path, how: str) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import asyncio, bus\n"
        "from bus.msg.std_msgs import String\n"
        "async def main():\n"
        "    global node\n"
        "    node = bus.Node('kept')\n"
        "    await node.open()\n"
        "    await node.create_subscription(String, 't', 10, print)\n"
        f"{how}\n"
        "script = bus.connect('script')\n"
        "script.publish('t', String(data='heard'))\n"
    )
    words = [sys.executable, "-W", "default::ResourceWarning", str(program)]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=WAIT_S, check=True)
    assert f"{program}:5: ResourceWarning: node /kept was never closed" in ended.stderr
    assert f"{program}:9: ResourceWarning: node /script was never closed" in ended.stderr
    assert "Traceback" not in ended.stderr
