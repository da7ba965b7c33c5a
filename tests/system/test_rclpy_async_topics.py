"""Publishers and subscriptions of an AsyncNode, by both routes and on both event loops."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from bus.endpoint.endpoint import core_of
from bus.msg.std_msgs import String as NativeString
from bus.node import Node as NativeNode
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.experimental import AsyncNode, AsyncPublisher
from bus_ros.rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions
from rclpy_async_world import String, context, node
from semantics import until

__all__ = ["context", "node"]

pytestmark = pytest.mark.usefixtures("route", "context")


def rings() -> int:
    """The number of this process's descriptors of rings."""
    return sum(
        "busd-ring" in str(one.readlink()) for one in Path("/proc/self/fd").iterdir() if one.is_symlink()
    )


class TestTopics:
    async def test_a_message_published_at_once_reaches_a_subscription_made_before(self) -> None:
        got: list[str] = []
        async with AsyncNode("tester") as node:
            publisher = node.create_publisher(String, "chatter", 10)
            node.create_subscription(String, "chatter", lambda message: got.append(message.data), 10)
            publisher.publish(String(data="hello"))
            await until(lambda: got)
        assert got == ["hello"]

    async def test_between_two_nodes_of_one_loop(self) -> None:
        got: list[str] = []
        async with AsyncNode("a") as a, AsyncNode("b") as b:
            publisher = a.create_publisher(String, "chatter", 10)
            await until(lambda: publisher.state.name == "OPEN")
            b.create_subscription(String, "chatter", lambda message: got.append(message.data), 10)
            publisher.publish(String(data="1"))
            publisher.publish(String(data="2"))
            await until(lambda: len(got) == 2)
        assert got == ["1", "2"]

    async def test_made_before_the_node_runs(self) -> None:
        node = AsyncNode("tester")
        got: list[str] = []
        publisher = node.create_publisher(String, "chatter", 2)
        node.create_subscription(String, "chatter", lambda message: got.append(message.data), 10)
        for text in "abc":  # beyond the depth: the oldest is replaced
            publisher.publish(String(data=text))
        async with node:
            publisher.publish(String(data="d"))
            await until(lambda: "d" in got)
        assert got == ["b", "c", "d"]

    async def test_a_destroyed_publisher_frees_its_memory_at_once(self, node: AsyncNode) -> None:
        """Without a turn of the loop, and without Python's collector."""
        publisher = node.create_publisher(String, "chatter", 10)
        await until(lambda: publisher.state.name == "OPEN")
        publisher.publish(String(data="x"))
        assert publisher._native is not None
        core = core_of(publisher._native)
        await until(lambda: core.is_drained)
        before, shares = rings(), core.sender.ring is not None
        publisher.destroy()
        assert rings() == before - shares

    async def test_a_message_before_the_end_of_the_block_is_published(self) -> None:
        async with NativeNode("listener", arguments=[]) as listener:
            subscription = await listener.create_subscription(NativeString, "chatter")
            async with AsyncNode("tester") as node:
                node.create_publisher(String, "chatter", 10).publish(String(data="last words"))
            message, _ = await subscription.receive()
        assert message.data == "last words"

    async def test_async_callbacks_come_one_after_the_other(self, node: AsyncNode) -> None:
        running, most, calls = 0, 0, 0

        async def callback(message: Any) -> None:
            nonlocal running, most, calls
            running += 1
            most = max(most, running)
            await asyncio.sleep(0.001)
            running -= 1
            calls += 1

        publisher = node.create_publisher(String, "chatter", 10)
        node.create_subscription(String, "chatter", callback, 10)
        for _ in range(5):
            publisher.publish(String())
        await until(lambda: calls == 5)
        assert most == 1

    async def test_concurrent_callbacks_run_together(self, node: AsyncNode) -> None:
        meeting = asyncio.Barrier(3)
        ended: list[int] = []

        async def callback(message: Any, info: Any) -> None:
            await meeting.wait()
            ended.append(info["publication_sequence_number"])

        publisher = node.create_publisher(String, "chatter", 10)
        node.create_subscription(String, "chatter", callback, 10, concurrent=True)
        for _ in range(3):
            publisher.publish(String())
        await until(lambda: len(ended) == 3)
        assert sorted(ended) == [1, 2, 3]

    async def test_raw_and_info(self, node: AsyncNode) -> None:
        got: list[tuple[bytes, Any]] = []
        publisher = node.create_publisher(String, "chatter", 10)
        node.create_subscription(String, "chatter", lambda data, info: got.append((data, info)), 10, raw=True)
        publisher.publish(b"\x91\xa2hi")
        await until(lambda: got)
        assert bytes(got[0][0]) == b"\x91\xa2hi" and got[0][1]["source_timestamp"] > 10**18

    async def test_a_content_filter(self, node: AsyncNode) -> None:
        got: list[str] = []
        publisher = node.create_publisher(String, "chatter", 10)
        subscription = node.create_subscription(
            String,
            "chatter",
            lambda message: got.append(message.data),
            10,
            content_filter_options=ContentFilterOptions("data = %0", ["'b'"]),
        )
        assert subscription.is_cft_enabled
        for text in "abc":
            publisher.publish(String(data=text))
        await until(lambda: got)
        subscription.set_content_filter("", [])
        publisher.publish(String(data="d"))
        await until(lambda: "d" in got)
        assert got[0] == "b" and "a" not in got

    async def test_iteration_ends_with_the_subscription(self, node: AsyncNode) -> None:
        publisher = node.create_publisher(String, "chatter", 10)
        subscription = node.create_subscription(String, "chatter", None, 10)
        publisher.publish(String(data="1"))
        publisher.publish(String(data="2"))
        got = []
        async for message in subscription:
            got.append(message.data)
            if len(got) == 2:
                subscription.destroy()
        assert got == ["1", "2"]
        with pytest.raises(InvalidHandle, match="is destroyed"):
            await subscription.receive()

    async def test_a_replaced_callback(self, node: AsyncNode) -> None:
        first: list[Any] = []
        second: list[Any] = []
        publisher = node.create_publisher(String, "chatter", 10)
        subscription = node.create_subscription(String, "chatter", first.append, 10)
        publisher.publish(String())
        await until(lambda: first)
        subscription.callback = second.append
        publisher.publish(String())
        await until(lambda: second)
        assert len(first) == 1
        with pytest.raises(TypeError, match="make a new subscription"):
            subscription.callback = lambda message, info: None

    async def test_destroyed_ones_are_silent(self, node: AsyncNode) -> None:
        got: list[Any] = []
        publisher = node.create_publisher(String, "chatter", 10)
        subscription = node.create_subscription(String, "chatter", got.append, 10)
        publisher.publish(String())
        await until(lambda: got)
        subscription.destroy()
        publisher.publish(String())
        await until(lambda: publisher.get_subscription_count() == 0)
        assert len(got) == 1 and list(node.subscriptions) == []
        publisher.destroy()
        with pytest.raises(InvalidHandle, match="the publisher on '/chatter' is destroyed"):
            publisher.publish(String())

    async def test_wrong_messages(self, node: AsyncNode) -> None:
        publisher = node.create_publisher(String, "chatter", 10)
        with pytest.raises(TypeError, match="Expected"):
            publisher.publish("text")  # type: ignore[arg-type]
        await until(lambda: publisher.state.name == "OPEN")
        with pytest.raises(TypeError, match="Expected"):
            publisher.publish("text")  # type: ignore[arg-type]

    async def test_send_takes_what_publish_takes(self, node: AsyncNode) -> None:
        """Serialized messages, and messages of subclasses, also while a subscription is made."""

        class Own(String):  # type: ignore[misc]
            pass

        got: list[str] = []
        publisher: AsyncPublisher[Any] = node.create_publisher(String, "chatter", 10)
        await until(lambda: publisher.state.name == "OPEN")
        await publisher.send(String(data="1"))
        for _ in range(2):
            node.create_subscription(String, "chatter", lambda message: got.append(message.data), 10)
            await publisher.send(String(data="2"))
            await publisher.send(b"\x91\xa13")
            await publisher.send(Own(data="4"))
            await until(lambda: publisher._holds == 0)
        await until(lambda: len(got) == 9)
        assert sorted(got) == ["2"] * 3 + ["3"] * 3 + ["4"] * 3
        for wrong in ("text", None):
            with pytest.raises(TypeError, match="Expected"):
                await publisher.send(wrong)
        sending = publisher.send(String(data="5"))
        publisher.destroy()
        with pytest.raises(InvalidHandle, match="the publisher on '/chatter' is destroyed"):
            await publisher.send(String(data="6"))
        with pytest.raises(InvalidHandle):
            await sending  # it had not begun

    async def test_a_publisher_class_of_the_program(self, node: AsyncNode) -> None:
        sent: list[Any] = []

        class Noting(AsyncPublisher[Any]):
            async def send(self, msg: Any) -> None:  # type: ignore[override]
                sent.append(msg)
                await super().send(msg)

        got: list[Any] = []
        node.create_subscription(String, "chatter", got.append, 10)
        publisher = node.create_publisher(String, "chatter", 10, publisher_class=Noting)
        await until(lambda: publisher.state.name == "OPEN" and not publisher._holds)
        await publisher.send(String(data="a"))
        await until(lambda: got)
        assert sent == got == [String(data="a")]

    async def test_a_lossless_publisher_waits_for_room(self, node: AsyncNode) -> None:
        lossless = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=0)
        publisher: AsyncPublisher[Any] = node.create_publisher(String, "chatter", lossless)
        subscription = node.create_subscription(String, "chatter", None, lossless)
        await until(lambda: publisher.get_subscription_count() == 1)

        def flood() -> int:
            for number in range(10**6):
                try:
                    publisher.publish(String(data="x" * 10_000))
                except RuntimeError as error:
                    assert "await publisher.send(message)" in str(error)
                    return number
            raise AssertionError("there was always room")

        sent = flood()
        sending = asyncio.create_task(publisher.send(String(data="last")))
        got = 0
        async for message in subscription:
            got += 1
            if message.data == "last":
                break
        await sending
        assert got == sent + 1

    async def test_a_late_joiner_gets_the_history(self) -> None:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        got: list[str] = []
        async with AsyncNode("tester") as node:
            publisher = node.create_publisher(String, "map", latched)
            publisher.publish(String(data="old"))
            publisher.publish(String(data="new"))
            await until(lambda: publisher.state.name == "OPEN")
            async with AsyncNode("late") as late:
                late.create_subscription(String, "map", lambda message: got.append(message.data), latched)
                await until(lambda: got)
        assert got == ["new"]


class TestForgottenCoroutines:
    """A callback that is not async but returns a coroutine."""

    @staticmethod
    async def never(*arguments: object) -> None:
        raise AssertionError

    @staticmethod
    def cause(raised: pytest.ExceptionInfo[ExceptionGroup[Exception]]) -> str:
        (error,) = raised.value.exceptions
        assert isinstance(error, TypeError)
        return str(error)

    async def test_of_subscriptions(self) -> None:
        for callback in (lambda message: self.never(), lambda message, info: self.never()):
            with pytest.raises(ExceptionGroup) as raised:
                async with AsyncNode("tester") as node:
                    publisher = node.create_publisher(String, "chatter", 10)
                    node.create_subscription(String, "chatter", callback, 10)
                    publisher.publish(String(data="hello"))
                    await asyncio.Event().wait()
            assert ".<lambda> (" in self.cause(raised)
            assert " returned the coroutine TestForgottenCoroutines.never, " in self.cause(raised)

    async def test_of_a_timer(self) -> None:
        with pytest.raises(ExceptionGroup) as raised:
            async with AsyncNode("tester") as node:
                node.create_timer(0.001, lambda: self.never())
                await asyncio.Event().wait()
        assert " returned the coroutine TestForgottenCoroutines.never, " in self.cause(raised)
