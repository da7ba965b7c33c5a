"""Edge cases of publishing and taking: threads, restarts, expiry, slow and failing callbacks."""

import asyncio
import threading
import time
from functools import partial
from itertools import pairwise
from typing import Any

import msgspec
import pytest

import bus
from bus.msg.std_msgs import Int32, String
from conftest import WAIT_S, Daemon
from semantics import KEEP_ALL, LATCHED, accounted, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


class Picky(msgspec.Struct):
    """Its constructor refuses some values that decode well."""

    number: int = 0

    def __post_init__(self) -> None:
        assert self.number != 1


class TestThreads:
    async def test_a_lossless_publisher_refuses_and_loses_nothing(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        accepted: list[int] = []

        def work() -> None:
            accepted.extend(n for n in range(200_000) if publisher.publish(Int32(data=n)))

        thread = threading.Thread(target=work)
        thread.start()
        await asyncio.to_thread(thread.join)
        assert publisher.statistics().refused == 200_000 - len(accepted) > 0
        heard = [(await subscription.receive())[0].data for _ in accepted]
        assert heard == accepted

    async def test_what_the_depth_replaces_is_accounted_for(self, node: bus.Node, route: str) -> None:
        subscription = await node.create_subscription(Int32, "t", 10)
        publisher = await node.create_publisher(Int32, "t", 10)
        for thread in [threading.Thread(target=publish_many, args=(publisher, 1000)) for _ in range(3)]:
            thread.start()
            thread.join()
        await until(lambda: accounted(subscription) == 3000)
        assert publisher.statistics().published == 3000
        dropped = subscription.statistics().dropped
        if route == "socket":
            assert publisher.statistics().replaced == dropped["publisher_queue"] > 0
        else:
            assert dropped["replaced"] > 0

    async def test_many_small_messages_make_no_frame_that_is_too_long(
        self, start_daemon: Any, socket_path: Any
    ) -> None:
        config = socket_path.with_suffix(".toml")
        config.write_text("[limits]\nmessage_bytes = 65536\n")
        start_daemon("--config", str(config))
        async with asyncio.timeout(WAIT_S), bus.Node("small", arguments=[]) as node:
            subscription = await node.create_subscription(String, "t", KEEP_ALL)
            publisher = await node.create_publisher(String, "t", KEEP_ALL)
            thread = threading.Thread(target=publish_texts, args=(publisher, 200))
            thread.start()
            thread.join()
            for _ in range(200):
                await subscription.receive()


class TestRestart:
    async def test_flush_waits_for_a_broker_that_is_away(self, daemon: Daemon, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", LATCHED)
        publisher = await node.create_publisher(Int32, "t", LATCHED)
        publisher.publish(Int32(data=0))
        await subscription.receive()
        daemon.kill()
        await until(lambda: not publisher.matches)
        for number in range(1, 4):
            publisher.publish(Int32(data=number))
        flushing = asyncio.create_task(publisher.flush())
        daemon.restart()
        await flushing
        assert [(await subscription.receive())[0].data for _ in range(3)] == [1, 2, 3]

    async def test_samples_of_an_earlier_broker_keep_their_publisher(
        self, daemon: Daemon, node: bus.Node
    ) -> None:
        other = await node.create_publisher(Int32, "other", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        for number in range(100):
            publisher.publish(Int32(data=number))
        await until(lambda: subscription.statistics().queued == 100)
        await other.close()  # so that the next broker assigns other ids
        daemon.kill()
        await until(lambda: not publisher.matches)
        daemon.restart()
        await publisher.wait_for_subscriptions(1)
        gids = {(await subscription.receive())[1].publisher_gid for _ in range(100)}
        assert gids == {publisher.gid}
        await publisher.send(Int32(data=100))
        assert (await subscription.receive())[0].data == 100
        assert "cut off" not in daemon.log.read_text()


class TestCallbacks:
    async def test_a_slow_callback_leaves_timers_their_turn(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Int32, "t", 50, lambda message: time.sleep(0.006))
        publisher = await node.create_publisher(Int32, "t", 50)
        ticks: list[int] = []
        node.create_timer(0.001, lambda: ticks.append(subscription.statistics().delivered))
        for number in range(50):
            publisher.publish(Int32(data=number))
            await asyncio.sleep(0)
        await until(lambda: accounted(subscription) == 50 and not subscription.statistics().queued)
        assert max(after - before for before, after in pairwise(ticks)) <= 10

    async def test_an_async_callback_that_raised_is_called_again(self, daemon: Daemon) -> None:
        errors: list[Any] = []
        heard: list[int] = []

        async def fail(message: Int32) -> None:
            heard.append(message.data)
            raise ValueError(message.data)

        asyncio.get_running_loop().set_exception_handler(lambda loop, context: errors.append(context))
        node = bus.Node("lone", arguments=[])
        async with asyncio.timeout(WAIT_S):
            await node.open()
            await node.create_subscription(Int32, "t", 10, fail)
            publisher = await node.create_publisher(Int32, "t", 10)
            for number in range(3):
                publisher.publish(Int32(data=number))
            await until(lambda: len(heard) == 3)
            await node.close()
        assert errors

    @pytest.mark.parametrize("with_info", [False, True])
    async def test_an_async_callback_that_awaited_a_cancelled_task_is_called_again(
        self, daemon: Daemon, with_info: bool
    ) -> None:
        """A CancelledError of the callback must not end the task that calls back."""
        errors: list[Any] = []
        heard: list[int] = []
        cancelled = asyncio.ensure_future(asyncio.sleep(1000))
        cancelled.cancel()

        async def callback(message: Int32) -> None:
            heard.append(message.data)
            await cancelled

        async def callback_with_info(message: Int32, info: bus.MessageInfo) -> None:
            await callback(message)

        asyncio.get_running_loop().set_exception_handler(lambda loop, context: errors.append(context))
        node = bus.Node("lone", arguments=[])
        async with asyncio.timeout(WAIT_S):
            await node.open()
            await node.create_subscription(Int32, "t", 10, callback_with_info if with_info else callback)
            publisher = await node.create_publisher(Int32, "t", 10)
            for number in range(3):
                publisher.publish(Int32(data=number))
            await until(lambda: len(heard) == 3)
            await node.close()
        assert [str(context["exception"]).endswith("awaited a cancelled task") for context in errors] == [
            True
        ] * 3

    async def test_a_node_that_is_entered_again_after_an_error(self, daemon: Daemon) -> None:
        node = bus.Node("twice", arguments=[])

        def fail(text: str) -> None:
            raise ValueError(text)

        for text in ("first", "second"):
            with pytest.raises(ValueError, match=text):
                async with asyncio.timeout(WAIT_S), node:
                    node.create_timer(0.001, partial(fail, text))
                    await node.spin()
        async with asyncio.timeout(WAIT_S), node:
            pass

    async def test_a_node_that_is_open_is_not_opened_again(self, node: bus.Node) -> None:
        with pytest.raises(bus.LocalProtocolError, match="is open already: async with opens it, too"):
            await node.open()
        names = [one.full_name for one in (await node.graph()).nodes]
        assert names.count(node.full_name) == 1


class TestTaking:
    async def test_a_class_that_raises_what_it_likes(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Picky, "t", 10)
        publisher = await node.create_publisher(Picky, "t", 10)
        for number in (0, 1, 2):
            publisher.publish_encoded(msgspec.msgpack.encode({"number": number}))
        assert [(await subscription.receive())[0].number for _ in range(2)] == [0, 2]
        assert subscription.statistics().dropped == {"undecodable": 1}

    async def test_a_thousand_bad_messages_in_a_row(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(String, "t", 3000)
        publisher = await node.create_publisher(String, "t", 1)
        for _ in range(2000):
            publisher.publish_encoded(b"\xc1")
            await asyncio.sleep(0)
        publisher.publish(String(data="good"))
        assert (await subscription.receive())[0].data == "good"

    async def test_expired_samples_do_not_hold_a_lossless_publisher(self, node: bus.Node) -> None:
        qos = bus.QoSProfile(history="keep_all", lifespan=0.1)
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher = await node.create_publisher(Int32, "t", qos)
        while publisher.publish(Int32()):
            pass
        await asyncio.sleep(0.15)  # the lifespan

        async def keep_sending() -> None:
            while True:  # on a busy machine one of these may expire, too
                await publisher.send(Int32(data=7))
                await asyncio.sleep(0.02)

        sending = asyncio.create_task(keep_sending())
        assert (await subscription.receive())[0].data == 7
        sending.cancel()


def publish_many(publisher: bus.Publisher[Int32], number: int) -> None:
    for data in range(number):
        publisher.publish(Int32(data=data))


def publish_texts(publisher: bus.Publisher[String], number: int) -> None:
    for _ in range(number):
        assert publisher.publish(String(data="x" * 4000))
