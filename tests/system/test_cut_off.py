"""A subscriber's process stands still and loses its connection, while publishers leave."""

import asyncio
import os
import re
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

import bus
from bus import shm
from bus.msg.std_msgs import String
from chaos.proxy import Proxy
from conftest import WAIT_S, Daemon
from programs import Program, running
from semantics import until

LONG = "x" * 20_000
"""Ten of these fill a socket; further ones wait in busd."""

LISTENER = """
import asyncio
import bus
from bus.msg.std_msgs import String

async def main():
    async with bus.Node("listener", arguments=[], rosout=False) as node:
        subscription = await node.create_subscription(String, "topic", 1000)
        told = None
        while True:
            while subscription.take():
                pass
            now = subscription.statistics()
            if now != told:
                told = now
                print(f"expected {now.expected} delivered {now.delivered} dropped {now.dropped}", flush=True)
            await asyncio.sleep(0.01)

bus.run(main())
"""


@pytest.fixture
def proxy(daemon: Daemon, tmp_path: Path) -> Iterator[Proxy]:
    """A proxy between the listener and busd, so that a test can cut their connection."""
    with Proxy(tmp_path / "proxy.sock", daemon.path) as proxy:
        yield proxy


@pytest.fixture
async def listener(proxy: Proxy, tmp_path: Path) -> AsyncIterator[Program]:
    async with running(tmp_path, "-c", LISTENER, BUSD_SOCKET=str(tmp_path / "proxy.sock")) as program:
        yield program
        program.process.send_signal(signal.SIGCONT)


@pytest.fixture
async def node(daemon: Daemon) -> AsyncIterator[bus.Node]:
    async with asyncio.timeout(WAIT_S), bus.Node("talker", arguments=[], rosout=False) as node:
        yield node


async def publish(publisher: bus.Publisher[String], count: int) -> None:
    for _ in range(count):
        publisher.publish(String(data=LONG))
        await publisher.flush()


def closed(listener: Program, expected: int) -> re.Match[str] | None:
    """The listener's line that accounts for all expected messages."""
    for line in listener.lines:
        found = re.search(
            rf"expected {expected} delivered (\d+) dropped {{(?:'disconnected': (\d+))?}}$", line
        )
        if found and int(found[1]) + int(found[2] or 0) == expected:
            return found
    return None


async def until_told(node: bus.Node, expected: int, lost: int) -> None:
    """Wait until the listener is back and the graph has the same counters."""
    due = (expected, expected - lost, lost)
    while True:
        for subscription in (await node.graph(statistics=True)).subscriptions:
            told = subscription.statistics
            if told and (told.expected, told.samples, told.dropped.get("disconnected", 0)) == due:
                return
        await asyncio.sleep(0.01)


@pytest.mark.parametrize("leaves", ["before", "after"])
async def test_what_a_publisher_that_has_left_had_published(
    route: str, listener: Program, proxy: Proxy, node: bus.Node, leaves: str
) -> None:
    """The publisher leaves before or after busd cuts off the stopped process.

    The publisher's ring has grown before. busd has reported that, but the report is still unread in the
    socket.
    """
    publisher = await node.create_publisher(String, "topic", 1000)
    await publisher.wait_for_subscriptions()
    await publish(publisher, 5)
    await listener.line("expected 5 delivered 5 ")
    listener.process.send_signal(signal.SIGSTOP)
    await publish(publisher, 30)
    if leaves == "before":
        await publisher.close()
    await node.graph()  # busd has read all that, and has sent its reports to the listener
    proxy.hang_up()
    while len((await node.graph()).nodes) > 1:  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    if leaves == "after":
        await publish(publisher, 20)
        await publisher.close()
    listener.process.send_signal(signal.SIGCONT)
    expected = 35 if leaves == "before" else 55
    await until(lambda: closed(listener, expected))
    found = closed(listener, expected)
    assert found is not None
    lost = int(found[2] or 0)
    assert (0 < lost < expected - 5) if route == "socket" else not lost
    await until_told(node, expected, lost)


@pytest.mark.skipif(not shm.is_available(), reason="without shared memory there are no rings")
@pytest.mark.parametrize("leaves", [False, True])
async def test_what_was_published_into_a_ring_of_which_it_was_not_told_in_time(
    daemon: Daemon, listener: Program, proxy: Proxy, node: bus.Node, leaves: bool
) -> None:
    """The ring grew just before the cut-off: messages in it are lost only if the publisher has left."""
    publisher = await node.create_publisher(String, "topic", 1000)
    await publisher.wait_for_subscriptions()
    await publish(publisher, 5)
    await listener.line("expected 5 delivered 5 ")
    listener.process.send_signal(signal.SIGSTOP)
    os.kill(daemon.pid, signal.SIGSTOP)
    await publish(publisher, 30)
    proxy.hang_up()
    await until(lambda: proxy.hang_ups == 1)
    os.kill(daemon.pid, signal.SIGCONT)
    while len((await node.graph()).nodes) > 1:  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    if leaves:
        await publisher.close()
    listener.process.send_signal(signal.SIGCONT)
    await until(lambda: closed(listener, 35))
    found = closed(listener, 35)
    assert found is not None
    lost = int(found[2] or 0)
    assert (0 < lost < 30) if leaves else not lost
    await until_told(node, 35, lost)


@pytest.mark.skipif(not shm.is_available(), reason="without shared memory there are no rings")
async def test_what_a_publisher_has_left_in_a_ring_that_was_never_read(
    listener: Program, proxy: Proxy, node: bus.Node
) -> None:
    """The ring grew during the cut-off, and is gone with its publisher."""
    publisher = await node.create_publisher(String, "topic", 1000)
    await publisher.wait_for_subscriptions()
    await publish(publisher, 5)
    await listener.line("expected 5 delivered 5 ")
    listener.process.send_signal(signal.SIGSTOP)
    proxy.hang_up()
    while len((await node.graph()).nodes) > 1:  # noqa: ASYNC110
        await asyncio.sleep(0.01)
    await node.create_subscription(String, "topic", 1000, callback=lambda message: None)
    await publisher.wait_for_subscriptions()
    await publish(publisher, 900)
    await publisher.close()
    listener.process.send_signal(signal.SIGCONT)
    await until(lambda: closed(listener, 905))
    found = closed(listener, 905)
    assert found is not None
    assert int(found[2] or 0) > 0, "the ring has grown"
