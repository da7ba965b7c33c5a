"""The clock of log times, without a bus."""

import asyncio
from typing import Any

import pytest

from bus.logger import get_logger
from bus.msg.builtin_interfaces import Time
from bus.types.classes import message_class
from bus_bag.record.clock import RecordingClock

Clock: Any = message_class("rosgraph_msgs/msg/Clock")


class Node:
    """A node whose own subscription to /clock gets nothing, until the test sets `time`. Another subscription
    gets `times`, then raises `end`, or nothing more comes."""

    def __init__(self, *times: Time, end: Exception | None = None) -> None:
        self.time = Time()
        self.is_read = asyncio.Event()
        """Set after all `times` are received."""
        self.is_closed = False
        self._times = iter(times)
        self._end = end

    def now(self) -> Time:
        return self.time

    def get_logger(self) -> Any:
        return get_logger("recorder")

    async def create_subscription(self, *words: Any) -> "Node":
        return self

    async def receive(self) -> tuple[Any, None]:
        for time in self._times:
            return Clock(clock=time), None
        self.is_read.set()
        if self._end is not None:
            raise self._end
        await asyncio.Event().wait()
        raise AssertionError

    async def close(self) -> None:
        self.is_closed = True


async def begin(node: Any) -> tuple["asyncio.Task[None]", asyncio.Event]:
    """The waiting task after the node has received all times, and the event that ends it."""
    stopped = asyncio.Event()
    waiting = asyncio.create_task(RecordingClock(node, is_simulated=True).wait_for_begin(stopped))
    await asyncio.wait(
        [waiting, asyncio.create_task(node.is_read.wait())], return_when=asyncio.FIRST_COMPLETED
    )
    return waiting, stopped


async def test_a_simulation_that_has_not_begun() -> None:
    node = Node(Time(), Time(), Time(sec=-1))
    waiting, _ = await begin(node)
    assert not waiting.done()
    waiting.cancel()


async def test_the_node_gets_the_time_a_moment_later(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Node(Time(), Time(nanosec=1))
    turns = 0

    async def sleep(seconds: float) -> None:
        nonlocal turns
        turns += 1
        if turns == 5000:
            node.time = Time(sec=1)

    monkeypatch.setattr(asyncio, "sleep", sleep)
    waiting, _ = await begin(node)
    await waiting
    assert node.time.sec and node.is_closed


async def test_stopped_before_it_begins() -> None:
    node = Node(Time())
    waiting, stopped = await begin(node)
    stopped.set()
    await waiting
    assert node.is_closed


async def test_a_subscription_that_ends() -> None:
    waiting, _ = await begin(Node(Time(), end=ConnectionError("gone")))
    with pytest.raises(ConnectionError, match="gone"):
        await waiting
