"""A process that forks: the child gets an error if it uses the parent's node, and does it no harm."""

import asyncio
import contextlib
import gc
import os
import signal
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

import bus
from bus import shm
from bus.msg.std_msgs import Int32, String
from conftest import WAIT_S, Daemon
from semantics import KEEP_ALL, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


class Frame(msgspec.Struct):
    """A message with a long field of bytes."""

    number: int = 0
    data: bytes = b""


def in_a_child(act: Callable[[], Any]) -> int:
    """Runs `act` in a child; the child's exit status, which is the result of `act` (None: 0)."""
    child = os.fork()
    if not child:
        status = 99
        try:
            status = act() or 0
        finally:
            os._exit(status)
    return exit_status(child)


def exit_status(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


async def test_the_child_is_told(node: bus.Node) -> None:
    publisher = await node.create_publisher(Int32, "t", 10)
    subscription = await node.create_subscription(Int32, "t", 10)
    publisher.publish(Int32(data=1))  # its run is still open, and the child must not add to it
    publisher.publish(Int32(data=2))
    child = os.fork()
    if not child:
        status = 99
        try:
            status = await failures(node, publisher, subscription)
        finally:
            os._exit(status)
    assert exit_status(child) == 0
    publisher.publish(Int32(data=3))
    assert [(await subscription.receive())[0].data for _ in range(3)] == [1, 2, 3]
    assert [one.name for one in (await node.graph()).nodes] == ["tester"]


async def failures(
    node: bus.Node, publisher: bus.Publisher[Int32], subscription: bus.Subscription[Int32]
) -> int:
    """In the child: 0 if every call raises ForkError."""
    failed = 0
    with contextlib.suppress(bus.ForkError):
        publisher.publish(Int32(data=666))
        failed |= 1
    with contextlib.suppress(bus.ForkError):
        await publisher.send(Int32(data=666))
        failed |= 2
    with contextlib.suppress(bus.ForkError):
        await subscription.receive()
        failed |= 4
    with contextlib.suppress(bus.ForkError):
        await node.create_publisher(Int32, "t", 10)
        failed |= 8
    with contextlib.suppress(bus.ForkError):
        await node.graph()
        failed |= 16
    try:
        await node.close()
    except BaseException:
        failed |= 32
    return failed


def test_a_child_has_a_node_of_its_own(daemon: Daemon) -> None:
    """As with multiprocessing's fork: the child must not take the parent's link."""

    async def parent() -> None:
        async with asyncio.timeout(WAIT_S), bus.Node("parent", arguments=[], rosout=False) as node:
            subscription = await node.create_subscription(String, "t", 10)
            child = os.fork()
            if not child:
                status = 1
                try:
                    asyncio.set_event_loop(None)
                    asyncio._set_running_loop(None)
                    asyncio.run(talk())
                    status = 0
                finally:
                    os._exit(status)
            message, _ = await subscription.receive()
            assert message.data == "from the child"
            assert exit_status(child) == 0
            await node.wait_for_graph(lambda graph: [one.name for one in graph.nodes] == ["parent"])

    async def talk() -> None:
        async with bus.Node("child", arguments=[], rosout=False) as node:
            publisher = await node.create_publisher(String, "t", 10)
            await publisher.wait_for_subscriptions()
            publisher.publish(String(data="from the child"))
            await publisher.flush()

    asyncio.run(parent())


async def test_a_child_takes_nothing_from_the_parents_subscription(node: bus.Node) -> None:
    """A lossless publisher gets acknowledgements of taken messages, and only the parent may send them."""
    subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
    publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
    sent = 0
    while publisher.publish(Int32(data=sent)):
        sent += 1
    await until(lambda: subscription.statistics().queued > 0)

    def take() -> None:
        while subscription.take():
            pass
        subscription.statistics()

    assert in_a_child(take) == 0
    sending = asyncio.create_task(publisher.send(Int32(data=sent)))
    assert [(await subscription.receive())[0].data for _ in range(sent + 1)] == list(range(sent + 1))
    await sending
    assert subscription.statistics().dropped == {}


async def test_a_child_can_read_a_view_and_does_not_release_it(node: bus.Node) -> None:
    subscription = await node.create_subscription(Frame, "t", 1, views=True)
    publisher = await node.create_publisher(Frame, "t", 1)
    image = bytes(range(256)) * 1024
    publisher.publish(Frame(0, image))
    held = [(await subscription.receive())[0]]

    def drop() -> int:
        is_whole = held[0].data == image
        held.clear()
        gc.collect()
        return 0 if is_whole else 1

    assert in_a_child(drop) == 0
    for number in range(1, 50):  # many laps of the ring
        publisher.publish(Frame(number, bytes(len(image))))
        assert (await subscription.receive())[0].number == number
    assert held[0].data == image


async def test_a_loan_is_not_the_childs(node: bus.Node) -> None:
    subscription = await node.create_subscription(Frame, "t", 10)
    publisher = await node.create_publisher(Frame, "t", 10)
    loan = publisher.loan(Frame(1), "data", 100_000)
    assert loan is not None

    def publish() -> int:
        try:
            loan.publish()
        except bus.ForkError:
            return 0
        return 1

    in_a_child(loan.discard)
    assert in_a_child(publish) == 0
    loan.buffer[:] = b"x" * 100_000
    assert loan.publish()
    assert (await subscription.receive())[0] == Frame(1, b"x" * 100_000)
    publisher.publish(Frame(2))
    assert (await subscription.receive())[0].number == 2


async def test_a_child_that_lives_on_keeps_nobody_asleep(node: bus.Node) -> None:
    """It has the parent's doorbell, too; still, each notification must wake the parent."""
    subscription = await node.create_subscription(Int32, "t", 10)
    publisher = await node.create_publisher(Int32, "t", 10)
    child = os.fork()
    if not child:
        try:
            signal.pause()
        finally:
            os._exit(99)
    try:
        for number in range(20):
            publisher.publish(Int32(data=number))
            assert (await subscription.receive())[0].data == number
    finally:
        os.kill(child, signal.SIGKILL)
        exit_status(child)


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_a_child_leaves_the_parents_descriptors(node: bus.Node) -> None:
    """The child only drops its own copies: the parent's ring and doorbell still serve new matches."""
    publisher = await node.create_publisher(Int32, "t", 10)

    def let_go() -> None:
        nonlocal publisher
        del publisher
        gc.collect()

    assert in_a_child(let_go) == 0
    subscription = await node.create_subscription(Int32, "t", 10)
    publisher.publish(Int32(data=1))
    assert (await subscription.receive())[0].data == 1
