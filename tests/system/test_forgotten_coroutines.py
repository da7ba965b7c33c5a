"""Callbacks that are not async but return a coroutine: an error, on each way of a message and in timers."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

import bus
from bus.msg.std_msgs import Int64
from bus.qos import QoSProfile

TEXT = r"callback .*<lambda> \(.*test_forgotten_coroutines:\d+\) returned the coroutine never, which nothing "


async def never(*arguments: object) -> None:
    raise AssertionError


@pytest.mark.usefixtures("route")
@pytest.mark.parametrize(
    ("callback", "qos"),
    [
        (lambda message: never(message), 100),
        (lambda message, info: never(message), 100),
        (lambda message: never(message), QoSProfile(100, deadline=60.0)),
    ],
)
@pytest.mark.parametrize("count", [1, 20])
async def test_a_subscription(daemon: object, callback: Callable[..., Any], qos: Any, count: int) -> None:
    with pytest.raises(TypeError, match=TEXT):
        async with bus.Node("listener") as node:
            publisher = await node.create_publisher(Int64, "/numbers", qos)
            await node.create_subscription(Int64, "/numbers", qos, callback)
            for number in range(count):
                publisher.publish(Int64(data=number))
            await asyncio.Event().wait()


async def test_a_timer(daemon: object) -> None:
    with pytest.raises(TypeError, match=TEXT):
        async with bus.Node("ticker") as node:
            node.create_timer(0.001, lambda: never())
            await asyncio.Event().wait()


@pytest.mark.usefixtures("route")
async def test_a_task_is_no_coroutine(daemon: object) -> None:
    heard: list[int] = []
    done = asyncio.Event()

    async def hear(message: Int64) -> None:
        heard.append(message.data)
        if len(heard) == 3:
            done.set()

    async with bus.Node("listener") as node:
        publisher = await node.create_publisher(Int64, "/numbers", 10)
        await node.create_subscription(
            Int64, "/numbers", 10, lambda message: asyncio.ensure_future(hear(message))
        )
        for number in range(3):
            publisher.publish(Int64(data=number))
        await done.wait()
    assert sorted(heard) == [0, 1, 2]
