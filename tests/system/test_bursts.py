"""The warning about messages lost because a loop published without a pause."""

import asyncio
import os
import re
import signal
from typing import Any

import pytest

import bus
from bus.diagnostics.bursts import MANY
from bus.msg.std_msgs import String
from conftest import WAIT_S, Daemon
from semantics import node

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route", "daemon")

HOW = r": pause in between, raise the depth, or lose none by reliable \+ keep all and await send\(\)$"
SAID = {
    "shm": rf"\[WARN\] .*: ([\d,]+) messages on '/t' were published without a pause, and a subscription that "
    rf"keeps the last 5 loses those that it does not take in time{HOW}",
    "socket": rf"\[WARN\] .*: ([\d,]+) messages on '/t', published without a pause, were replaced in the "
    rf"publisher's own queue, which keeps the last 10{HOW}",
}


async def said(capfd: Any, pattern: str) -> list[str]:
    """The lines of the log up to the first one with `pattern`."""
    text = ""
    async with asyncio.timeout(WAIT_S):
        while not re.search(pattern, text, re.MULTILINE):
            text += capfd.readouterr().err
            await asyncio.sleep(0.002)
    return text.splitlines()


async def test_a_loop_without_a_pause(node: bus.Node, daemon: Daemon, route: str, capfd: Any) -> None:
    """It warns at intervals, not each time. busd is stopped meanwhile; otherwise it might be fast enough."""
    await node.create_subscription(String, "t", 5)
    publisher = await node.create_publisher(String, "t", 10)
    await publisher.wait_for_subscriptions()
    os.kill(daemon.pid, signal.SIGSTOP)
    try:
        for _ in range(3):
            for _ in range(20 * MANY):
                publisher.publish(String(data="x" * 100))
            await asyncio.sleep(0)
    finally:
        os.kill(daemon.pid, signal.SIGCONT)
    node.get_logger().info("all is said")
    warnings = [line for line in await said(capfd, "all is said") if "pause" in line]
    assert len(warnings) == 1
    found = re.search(SAID[route], warnings[0])
    assert found, warnings
    assert int(found[1].replace(",", "")) >= MANY


@pytest.mark.parametrize(
    ("number", "depth", "offered"),
    [(MANY - 1, 5, 10), (2 * MANY, 3 * MANY, 3 * MANY), (2 * MANY, 5, bus.QoSProfile(history="keep_all"))],
    ids=["few", "deep enough", "lossless"],
)
async def test_where_nothing_is_said(
    node: bus.Node, capfd: Any, number: int, depth: int, offered: bus.QoS
) -> None:
    is_lossless = not isinstance(offered, int)
    await node.create_subscription(String, "t", offered if is_lossless else depth)
    publisher = await node.create_publisher(String, "t", offered)
    await publisher.wait_for_subscriptions()
    for _ in range(number):
        publisher.publish(String(data="x"))
    await asyncio.sleep(0)
    node.get_logger().info("all is said")
    assert not [line for line in await said(capfd, "all is said") if "pause" in line]


async def test_pauses_are_enough(node: bus.Node, capfd: Any) -> None:
    """If messages are lost then, the subscription is too slow, and the publisher's process does not warn."""
    await node.create_subscription(String, "t", 1)
    publisher = await node.create_publisher(String, "t", 1)
    await publisher.wait_for_subscriptions()
    for _ in range(10):
        for _ in range(MANY // 4):
            publisher.publish(String(data="x"))
        await asyncio.sleep(0)
    node.get_logger().info("all is said")
    assert not [line for line in await said(capfd, "all is said") if "pause" in line]
