"""A program whose loop is blocked for longer than its lease keeps its place; publishers don't wait."""

import asyncio
import logging
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from bus_cli.query import Query
from conftest import WAIT_S, Daemon
from neighbours import wait_until, with_limits
from programs import running
from semantics import KEEP_ALL

LEASE_S = 1.0
LONG = "x" * 20_000

LISTENER = """
import asyncio, sys, time
from pathlib import Path
import bus
from bus.msg.std_msgs import String

async def main():
    async with bus.Node("listener", arguments=[], rosout=False) as node:
        heard = []

        def listen(message):
            heard.append(message)
            if len(heard) == 5:
                print("loading a model", flush=True)
                while not Path(sys.argv[1]).exists():
                    time.sleep(0.01)
                print("loaded", flush=True)

        every = bus.QoSProfile(history="keep_all")
        subscription = await node.create_subscription(String, "topic", every, listen)
        while True:
            now = subscription.statistics()
            total = now.delivered + now.queued + sum(now.dropped.values())
            print(f"expected {now.expected} accounted {total} dropped {now.dropped}", flush=True)
            await asyncio.sleep(0.05)

bus.run(main())
"""


@with_limits(lease_s=LEASE_S)
async def test_a_blocked_loop(
    route: str, daemon: Daemon, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A lossless publisher waits for it, then continues without it; messages missed by that are counted."""
    caplog.set_level(logging.INFO, "bus")
    async with (
        asyncio.timeout(WAIT_S),
        bus.Node("talker", arguments=[], rosout=False) as node,
        running(tmp_path, "-c", LISTENER, tmp_path / "loaded") as listener,
    ):
        matches: list[int] = []
        publisher = await node.create_publisher(
            String,
            "topic",
            KEEP_ALL,
            events=bus.PublisherEvents(matched=lambda change: matches.append(change.current_count)),
        )
        await publisher.wait_for_subscriptions()
        published = 0

        async def talk(is_over: Callable[[], bool]) -> None:
            nonlocal published
            while not is_over():
                await publisher.send(String(data=LONG))
                published += 1
                await asyncio.sleep(0.001)

        silent = f"no sign of life from -c (pid {listener.process.pid}) for "
        await talk(lambda: silent in daemon.log.read_text())
        assert "loaded" not in listener.lines
        assert {one.name for one in (await node.graph()).nodes} == {"talker", "listener"}
        enough = published + 1500  # more than the ring keeps
        await talk(lambda: published >= enough)
        (tmp_path / "loaded").touch()
        await talk(lambda: "loaded" in listener.lines)
        await talk(lambda: f"-c (pid {listener.process.pid}) is heard again, after" in daemon.log.read_text())
        for _ in range(100):
            await publisher.send(String(data=LONG))
        published += 100
        found = await listener.line(rf"expected {published} accounted {published} dropped (.*)$")
        assert bool(re.search(r"'publisher_queue': \d", found[1])) is (route == "shm"), found[1]
        assert matches == [1]
        said = [line for line in listener.lines if "[bus]" in line]
        # On a busy machine its loop may stand still once more.
        still = r"this program's event loop stood still for \d+ s: what waited for it has"
        assert said
        assert all(re.search(still, line) for line in said)
        told = [record.getMessage() for record in caplog.records]
        assert [
            line
            for line in told
            if re.match(r"'/topic' goes on without /listener: no sign of life for", line)
        ]
        assert [
            line for line in told if re.match(r"'/topic' waits for /listener again, which was silent", line)
        ]


FORKED = """
import asyncio, ctypes, os, sys
import bus

async def main():
    node = bus.Node("parent", arguments=[], rosout=False)
    await node.open()
    if not ctypes.CDLL(None).fork():  # as a library may do it: nobody in Python hears of it
        sys.stdin.read()
        os._exit(0)
    os._exit(0)

asyncio.run(main())
"""


@with_limits(lease_s=LEASE_S)
def test_a_process_that_has_ended(daemon: Daemon) -> None:
    """Its child holds the connection and sends nothing. busd must see that the process has ended."""
    with subprocess.Popen([sys.executable, "-c", FORKED], stdin=subprocess.PIPE) as parent:
        assert parent.wait(WAIT_S) == 0
        with Query(daemon.path) as query:
            assert [one.name for one in query.graph().nodes] == ["parent"]
            wait_until(lambda: not query.graph().nodes)
    cut_off = rf"cut off .*\(pid {parent.pid}\): no sign of life for .* s, and it has ended"
    wait_until(lambda: re.search(cut_off, daemon.log.read_text()) is not None)  # a thread writes the log
