"""Common parts of the tests of semantics: a node on the test's daemon, waits, profiles, a type."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any, ClassVar

import msgspec
import pytest

import bus
from bus.endpoint.endpoint import core_of
from conftest import WAIT_S, Daemon

KEEP_ALL = bus.QoSProfile(history="keep_all")
LATCHED = bus.QoSProfile(5, durability="transient_local")


class Wheel(msgspec.Struct):
    """A user's own type."""

    __type_name__: ClassVar[str] = "robot/msg/Wheel"
    name: str = ""
    speeds: list[float] = []


@pytest.fixture
async def node(daemon: Daemon) -> AsyncIterator[bus.Node]:
    """A node named tester."""
    async with asyncio.timeout(WAIT_S), bus.Node("tester", arguments=[]) as node:
        yield node


async def until(condition: Callable[[], Any]) -> None:
    """Wait until `condition` is true; a time is only the bound."""
    async with asyncio.timeout(WAIT_S):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.002)


async def until_busd_has_all(publisher: bus.Publisher[Any], node: bus.Node) -> None:
    """Wait until busd has read everything published by a publisher of that node.

    Else a late joiner may get history from the middle, and the rest as it comes.
    """
    await publisher.flush()
    await node.graph()


def accounted(subscription: bus.Subscription[Any]) -> int:
    statistics = subscription.statistics()
    return statistics.delivered + statistics.queued + sum(statistics.dropped.values())


async def send_all(publisher: bus.Publisher[Any], messages: list[Any]) -> None:
    for message in messages:
        await publisher.send(message)


def forget_calls(
    server: bus.ServiceServer, monkeypatch: pytest.MonkeyPatch, *, lost: int
) -> list[bus.RequestId]:
    """Make `server` forget its calls, as if it had sent answers that were lost.

    Of its denials, in the returned list, the first `lost` are lost, too.
    """
    core = core_of(server)
    core.at_work.clear()
    deny, denials = core._deny, list[bus.RequestId]()

    def lose(one: bus.RequestId) -> None:
        denials.append(one)
        if len(denials) > lost:
            deny(one)

    monkeypatch.setattr(core, "_deny", lose)
    return denials
