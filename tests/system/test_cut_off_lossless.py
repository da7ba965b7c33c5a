"""A lossless stream while connections to a living busd are cut, or processes are killed."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import Int64
from chaos.proxy import Proxy
from conftest import WAIT_S, Daemon
from programs import running
from semantics import until

KEEP_ALL = bus.QoSProfile(history="keep_all")
MESSAGES = 3_000
CUTS = 6

LISTENER = """
import asyncio
import bus
from bus.msg.std_msgs import Int64

async def main():
    async with bus.Node("listener", arguments=[], rosout=False) as node:
        subscription = await node.create_subscription(Int64, "topic", bus.QoSProfile(history="keep_all"))
        due = 1
        while True:
            message, _ = await subscription.receive()
            assert message.data == due, f"{message.data} in place of {due}"
            due += 1
            if message.data % 100 == 0:
                print(f"up to {message.data}: {subscription.statistics().dropped}", flush=True)

bus.run(main())
"""

DEAF = """
import asyncio
import bus
from bus.msg.std_msgs import Int64

async def main():
    async with bus.Node("deaf", arguments=[], rosout=False) as node:
        await node.create_subscription(Int64, "topic", bus.QoSProfile(history="keep_all"))
        print("ready", flush=True)
        await asyncio.Event().wait()

bus.run(main())
"""


@pytest.fixture
def proxy(daemon: Daemon, tmp_path: Path) -> Iterator[Proxy]:
    with Proxy(tmp_path / "proxy.sock", daemon.path) as proxy:
        yield proxy


@pytest.fixture
async def node(daemon: Daemon) -> AsyncIterator[bus.Node]:
    async with asyncio.timeout(WAIT_S), bus.Node("talker", arguments=[], rosout=False) as node:
        yield node


async def test_nothing_is_lost_whenever_the_connection_of_the_subscription_is_cut(
    route: str, proxy: Proxy, node: bus.Node, tmp_path: Path
) -> None:
    async with running(tmp_path, "-c", LISTENER, BUSD_SOCKET=str(tmp_path / "proxy.sock")) as listener:
        publisher = await node.create_publisher(Int64, "topic", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        for number in range(1, MESSAGES + 1):
            await publisher.send(Int64(data=number))
            if number % (MESSAGES // CUTS) == 0:
                proxy.hang_up()
                cuts = number // (MESSAGES // CUTS)
                await until(lambda cuts=cuts: proxy.hang_ups == cuts)
        await listener.line(rf"up to {MESSAGES}: {{}}$")
        assert not any("AssertionError" in line for line in listener.lines)


async def test_one_that_is_killed_is_not_waited_for(
    route: str, daemon: Daemon, node: bus.Node, tmp_path: Path
) -> None:
    """A killed subscriber can't return, so its publisher continues long before the lease ends."""
    async with running(tmp_path, "-c", DEAF) as deaf:
        await deaf.line("ready")
        publisher = await node.create_publisher(Int64, "topic", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        while publisher.publish(Int64(data=1)):
            pass
        deaf.process.kill()
        async with asyncio.timeout(5):
            await publisher.send(Int64(data=2))
