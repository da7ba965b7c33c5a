"""Callbacks that hold the event loop up, in asyncio's debug mode."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from typing import Any

import pytest

import bus
from bus.diagnostics.slow_callback import SLOW_S, watched
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Empty
from conftest import WAIT_S
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("daemon")

LONG_S = 1.5 * SLOW_S


@pytest.fixture
async def debugging(node: bus.Node) -> AsyncIterator[None]:
    loop = asyncio.get_running_loop()
    before = loop.get_debug()
    loop.set_debug(True)
    yield
    loop.set_debug(before)


@pytest.fixture
def warned(node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the node's log warns of."""
    told: list[str] = []
    monkeypatch.setattr(type(node.get_logger()), "warning", lambda self, text, **_: told.append(text))
    return told


def block(*_: object) -> None:
    time.sleep(LONG_S)


async def block_in_between(*_: object) -> None:
    await asyncio.sleep(0)
    time.sleep(LONG_S)  # noqa: ASYNC251
    await asyncio.sleep(0)


async def only_wait(*_: object) -> None:
    await asyncio.sleep(LONG_S)


def line(name: str, what: str) -> re.Pattern[str]:
    return re.compile(
        rf"callback {name} of {what} took \d\d\d+ ms, while nothing else could run in this event loop "
        r"\(said once\)"
    )


CALLBACKS = pytest.mark.parametrize("callback", [block, block_in_between, partial(block, 1)])


@CALLBACKS
async def test_of_a_subscription(
    node: bus.Node, debugging: None, warned: list[str], callback: Callable[..., Any]
) -> None:
    subscription = await node.create_subscription(String, "t", 10, callback)
    publisher = await node.create_publisher(String, "t")
    for _ in range(2):
        publisher.publish(String())
    await until(lambda: subscription.statistics().delivered == 2 and warned)
    (text,) = warned
    assert line("block(_in_between)?", "subscription '/t'").fullmatch(text)


async def test_of_a_timer(node: bus.Node, debugging: None, warned: list[str]) -> None:
    timer = node.create_timer(0.001, block)
    await until(lambda: timer.calls > 1)
    timer.cancel()
    (text,) = warned
    assert line("block", "timer of /tester").fullmatch(text)
    assert repr(timer).startswith("<Timer canceled block ")


async def test_of_a_service(node: bus.Node, debugging: None, warned: list[str]) -> None:
    async def serve(request: Any, response: Any) -> Any:
        await block_in_between()
        return response

    await node.create_service(Empty, "s", serve)
    client = await node.create_client(Empty, "s")
    async with asyncio.timeout(WAIT_S):
        assert isinstance(await client.call(Empty.Request()), Empty.Response)
    (text,) = warned
    assert line(r"test_of_a_service\.<locals>\.serve", "service '/s'").fullmatch(text)


async def test_to_await_is_no_fault(node: bus.Node, debugging: None, warned: list[str]) -> None:
    subscription = await node.create_subscription(String, "t", 10, only_wait)
    publisher = await node.create_publisher(String, "t")
    for _ in range(2):
        publisher.publish(String())
    await until(lambda: subscription.statistics().delivered == 2)
    assert warned == []


async def test_what_it_awaits_and_raises_goes_through(node: bus.Node, debugging: None) -> None:
    """As without anybody who watches."""
    gone: list[str] = []

    async def asks(message: str, future: Awaitable[str]) -> str:
        try:
            return message + await future
        except (ValueError, asyncio.CancelledError) as error:
            gone.append(type(error).__name__)
            raise

    loop = asyncio.get_running_loop()
    call = watched(asks, "a test", node.get_logger())
    futures = [loop.create_future() for _ in range(3)]
    tasks = [loop.create_task(call("x", future)) for future in futures]
    await asyncio.sleep(0)
    futures[0].set_result("y")
    futures[1].set_exception(ValueError("no"))
    tasks[2].cancel()
    assert await tasks[0] == "xy"
    with pytest.raises(ValueError, match="no"):
        await tasks[1]
    with pytest.raises(asyncio.CancelledError):
        await tasks[2]
    assert gone == ["ValueError", "CancelledError"]


async def test_without_the_debug_mode_nothing_is_in_between(node: bus.Node) -> None:
    loop = asyncio.get_running_loop()
    before = loop.get_debug()
    loop.set_debug(False)
    try:
        assert watched(block, "a test", node.get_logger()) is block
    finally:
        loop.set_debug(before)
