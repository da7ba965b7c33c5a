"""Bounds on the calls of one paced message, from `publish` to the socket: see `callcount`."""

import asyncio

import msgspec
import pytest

import bus
from bus.msg.std_msgs import String
from bus.shm import has_core
from callcount import CallCounter

pytestmark = pytest.mark.usefixtures("daemon")

natively = pytest.mark.skipif(not has_core(), reason="the native core was not built")


class Text(msgspec.Struct):
    """Only for tests without the core, because the core caches its work for a type."""

    data: str = ""


async def calls_of_a_message(kind: type[String] | type[Text]) -> CallCounter:
    """The calls for one message by socket, sent some milliseconds after the one before."""
    async with bus.Node("talker", rosout=False, arguments=[]) as node:
        await node.create_subscription(kind, "calls", 10, lambda message: None)
        publisher = await node.create_publisher(kind, "calls", 10)
        await publisher.wait_for_subscriptions(1)
        message, sent = kind(data="x" * 64), list[CallCounter]()
        for _ in range(5):
            await asyncio.sleep(0.005)
            with CallCounter() as counter:
                publisher.publish(message)
            sent.append(counter)
        return min(sent, key=lambda one: one.python)


@natively
async def test_calls_by_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_ROUTE", "socket")
    counter = await calls_of_a_message(String)
    assert 3 <= counter.python <= 6
    assert counter.native <= 6
    assert counter.switches <= 5


async def test_calls_by_socket_without_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_NATIVE", "no")
    counter = await calls_of_a_message(Text)
    assert 8 <= counter.python <= 15
    assert counter.native <= 15
    assert counter.switches <= 10


@natively
async def test_calls_of_an_encoded_message_by_shared_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_ROUTE", "shm")
    async with bus.Node("talker", rosout=False, arguments=[]) as node:
        subscription = await node.create_subscription(String, "calls", 10)
        publisher = await node.create_publisher(String, "calls", 10)
        await publisher.wait_for_subscriptions(1)
        payload = msgspec.msgpack.encode(String(data="x" * 64))
        publisher.publish_encoded(payload)  # the first one schedules a report
        with CallCounter() as counter:
            publisher.publish_encoded(payload)
        assert counter.python <= 2
        for _ in range(2):
            assert (await subscription.receive())[0] == String(data="x" * 64)
