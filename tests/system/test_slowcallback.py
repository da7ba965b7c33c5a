"""Callbacks that block the event loop."""

import asyncio
import gc
import re
import time
import weakref
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Any

import pytest

import bus
from bus.base.awaited import mark_to_be_awaited
from bus.diagnostics.slow_callback import SLOW_NS, watched
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Empty
from bus_actions import ActionClient, ActionServer, ServerGoal, find_action
from conftest import WAIT_S
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("daemon")

LONG_S = 1.5 * SLOW_NS / 1e9


@pytest.fixture
def warned(node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The warnings in the node's log."""
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
        rf"callback {name} \(\S*test_slowcallback:\d+\) of {what} held up the event loop for \d\d\d+ ms, "
        r"in which nothing else ran: make it async def, with await asyncio\.to_thread\(\.\.\.\) "
        r"for the slow part \(said once\)"
    )


CALLBACKS = pytest.mark.parametrize("callback", [block, block_in_between, partial(block, 1)])


@CALLBACKS
async def test_of_a_subscription(node: bus.Node, warned: list[str], callback: Callable[..., Any]) -> None:
    subscription = await node.create_subscription(String, "t", 10, callback)
    publisher = await node.create_publisher(String, "t")
    for _ in range(2):
        publisher.publish(String())
    await until(lambda: subscription.statistics().delivered == 2 and warned)
    (text,) = warned
    assert line("block(_in_between)?", "subscription '/t'").fullmatch(text)


async def test_a_tool_is_not_told(warned: list[str]) -> None:
    """Its user can't change the callback, so there is no warning."""
    async with bus.Node("_tool", namespace="/tools", rosout=False) as tool:
        subscription = await tool.create_subscription(String, "t", 10, block)
        (await tool.create_publisher(String, "t")).publish(String())
        await until(lambda: subscription.statistics().delivered == 1)
    assert warned == []


async def test_of_a_timer(node: bus.Node, warned: list[str]) -> None:
    timer = node.create_timer(0.001, block)
    await until(lambda: timer.calls > 1)
    timer.cancel()
    (text,) = warned
    assert line("block", "timer of /tester").fullmatch(text)
    assert repr(timer).startswith("<Timer canceled block ")


async def test_of_a_service(node: bus.Node, warned: list[str]) -> None:
    async def serve(request: Any, response: Any) -> Any:
        await block_in_between()
        return response

    await node.create_service(Empty, "s", serve)
    client = await node.create_client(Empty, "s")
    async with asyncio.timeout(WAIT_S):
        assert isinstance(await client.call(Empty.Request()), Empty.Response)
    (text,) = warned
    assert line(r"test_of_a_service\.<locals>\.serve", "service '/s'").fullmatch(text)


async def test_of_an_action(node: bus.Node, warned: list[str]) -> None:
    Fibonacci = find_action("example_interfaces/action/Fibonacci")

    async def execute(goal: ServerGoal) -> Any:
        await block_in_between()
        return Fibonacci.Result()

    async with (
        ActionServer(node, Fibonacci, "count", execute, goal_callback=lambda goal: not block()),
        ActionClient(node, Fibonacci, "count") as client,
    ):
        goal = await client.send_goal(Fibonacci.Goal(order=1))
        await goal.result()
    first, second = warned
    assert line(r"test_of_an_action\.<locals>\.<lambda>", "action 'count'").fullmatch(first)
    assert line(r"test_of_an_action\.<locals>\.execute", "action 'count'").fullmatch(second)


async def test_to_await_is_no_fault(node: bus.Node, warned: list[str]) -> None:
    subscription = await node.create_subscription(String, "t", 10, only_wait)
    publisher = await node.create_publisher(String, "t")
    for _ in range(2):
        publisher.publish(String())
    await until(lambda: subscription.statistics().delivered == 2)
    assert warned == []


async def begin(work: Awaitable[Any]) -> Any:
    """Makes a coroutine for a task: from Python 3.12 on, asyncio accepts no awaitable generators."""
    return await work


async def test_what_it_awaits_and_raises_goes_through(node: bus.Node) -> None:
    """As without the wrapper that measures it."""
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
    tasks = [loop.create_task(begin(call("x", future))) for future in futures]
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


async def test_an_error_thrown_into_it_leaves_nothing_to_the_collector(node: bus.Node) -> None:
    class Message:
        pass

    async def waits(message: Message) -> None:
        await asyncio.get_running_loop().create_future()

    call = watched(waits, "a test", node.get_logger())

    async def cancel_one() -> weakref.ref[Message]:
        message = Message()
        task = asyncio.create_task(begin(call(message)))
        await asyncio.sleep(0)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        return weakref.ref(message)

    gc.disable()
    try:
        dropped = await asyncio.create_task(cancel_one())
        await asyncio.sleep(0)
        assert dropped() is None
    finally:
        gc.enable()


async def test_it_may_return_any_awaitable(node: bus.Node) -> None:
    def answer(message: str) -> Awaitable[str]:
        return asyncio.ensure_future(asyncio.sleep(0, message))

    mark_to_be_awaited(answer)
    assert await watched(answer, "a test", node.get_logger())("x") == "x"


async def test_of_two_arguments_and_one_that_raises(node: bus.Node, warned: list[str]) -> None:
    def fail(message: String) -> None:
        time.sleep(LONG_S)
        raise ValueError("too late")

    node._fail = lambda error: warned.append(repr(error))  # type: ignore[method-assign]
    node._context = type(node._context)(node._context.link, node.full_name, node.get_logger(), node._fail)
    publisher = await node.create_publisher(String, "t")
    subscription = await node.create_subscription(String, "t", 10, lambda message, info: time.sleep(LONG_S))
    publisher.publish(String())
    await until(lambda: len(warned) == 1)
    await subscription.close()
    await node.create_subscription(String, "t", 10, fail)
    publisher.publish(String())
    await until(lambda: len(warned) == 3)
    assert sorted(warned)[0] == "ValueError('too late')"


async def test_a_quick_one_is_none(node: bus.Node, warned: list[str]) -> None:
    subscription = await node.create_subscription(String, "t", 500, lambda message: None)
    publisher = await node.create_publisher(String, "t", 500)
    for _ in range(400):
        publisher.publish(String())
    await until(lambda: subscription.statistics().delivered == 400)
    assert warned == []
