"""Publishers, subscriptions and their events in the facade, by both routes."""

import threading
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus_ros.rclpy import publisher as publishers
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
)
from bus_ros.rclpy.serialization import deserialize_message, serialize_message
from bus_ros.rclpy.subscription import MessageInfo
from bus_ros.rclpy.subscription_content_filter_options import ContentFilterOptions
from bus_ros.rosidl import message_class
from rclpy_world import Int64, String, World, arguments, arrived, in_thread, wait_until, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
LATCHED = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


def numbers(count: int) -> list[Any]:
    return [Int64(data=number) for number in range(count)]


def published(node: Node, count: int, qos: QoSProfile | int, topic: str = "t") -> Any:
    """A publisher that has delivered `count` numbers."""
    publisher = node.create_publisher(Int64, topic, qos)
    for message in numbers(count):
        publisher.publish(message)
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    return publisher


class TestCallbacks:
    def test_of_one_argument(self, world: World, node: Node) -> None:
        heard: list[Any] = []
        subscription = node.create_subscription(Int64, "t", heard.append, 100)
        published(node, 50, 100)
        world.spin_until(lambda: len(heard) == 50)
        assert heard == numbers(50)
        assert all(type(one) is Int64 for one in heard)
        assert subscription.get_publisher_count() == 1
        assert subscription.topic == subscription.topic_name == "/t"

    def test_a_message_published_by_name(self, world: World, node: Node) -> None:
        heard: list[Any] = []
        node.create_subscription(Int64, "t", heard.append, 1)
        publisher = node.create_publisher(Int64, "t", 1)
        publisher.publish(msg=Int64(data=7))
        world.spin_until(lambda: heard)
        assert heard == [Int64(data=7)]
        with pytest.raises(TypeError):
            publisher.publish(message=Int64())  # type: ignore[call-arg]

    def test_of_two_arguments(self, world: World, node: Node) -> None:
        heard: list[tuple[Any, MessageInfo]] = []
        node.create_subscription(Int64, "t", lambda message, info: heard.append((message, info)), 100)
        before = node.get_clock().now().nanoseconds
        published(node, 3, 100)
        world.spin_until(lambda: len(heard) == 3)
        after = node.get_clock().now().nanoseconds
        assert [message.data for message, _ in heard] == [0, 1, 2]
        sequence = [info["publication_sequence_number"] for _, info in heard]
        assert sequence == [sequence[0] + index for index in range(3)]
        for _, info in heard:
            assert before <= info["source_timestamp"] <= info["received_timestamp"] <= after

    def test_an_argument_with_a_default_is_the_user_s(self, world: World, node: Node) -> None:
        heard: list[Any] = []
        node.create_subscription(Int64, "t", lambda message, mine="mine": heard.append(mine), 10)
        published(node, 1, 10)
        world.spin_until(lambda: heard)
        assert heard == ["mine"]

    def test_async(self, world: World, node: Node) -> None:
        heard: list[Any] = []

        async def later(message: Any, info: MessageInfo) -> None:
            heard.append((message.data, info["source_timestamp"] > 0))

        node.create_subscription(Int64, "t", later, 10)
        published(node, 5, 10)
        world.spin_until(lambda: len(heard) == 5)
        assert heard == [(number, True) for number in range(5)]

    def test_raw(self, world: World, node: Node) -> None:
        heard: list[bytes] = []
        subscription = node.create_subscription(Int64, "t", heard.append, 10, raw=True)
        published(node, 3, 10)
        world.spin_until(lambda: len(heard) == 3)
        assert subscription.raw
        assert all(type(one) is bytes for one in heard)
        assert [deserialize_message(one, Int64) for one in heard] == numbers(3)

    def test_one_that_raises_leaves_spin(self, world: World, node: Node) -> None:
        heard: list[int] = []

        def picky(message: Any) -> None:
            heard.append(message.data)
            if message.data == 1:
                raise ValueError("not this one")

        node.create_subscription(Int64, "t", picky, 100)
        published(node, 40, 100)
        with pytest.raises(ValueError, match="not this one"):
            rclpy.spin(node)
        assert heard == [0, 1]
        world.spin_until(lambda: len(heard) == 40)
        assert heard == list(range(40))


class TestQueues:
    def test_the_newest_are_kept_while_nobody_spins(self, world: World, node: Node) -> None:
        heard: list[int] = []
        subscription = node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 5)
        published(node, 50, 5)
        wait_until(lambda: arrived(subscription) == 50)
        world.spin_until(lambda: heard and heard[-1] == 49)
        assert heard == [45, 46, 47, 48, 49]

    def test_keep_all_keeps_all(self, world: World, node: Node) -> None:
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), KEEP_ALL)
        published_count = 3000
        publisher = node.create_publisher(Int64, "t", KEEP_ALL)
        with world.spinning(node):
            for message in numbers(published_count):
                publisher.publish(message)
            wait_until(lambda: len(heard) == published_count)
        assert heard == list(range(published_count))

    def test_late_subscriptions_get_the_latched(self, world: World, node: Node) -> None:
        published(node, 10, LATCHED)
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), LATCHED)
        world.spin_until(lambda: len(heard) == 3)
        assert heard == [7, 8, 9]

    @pytest.mark.parametrize("end", [3, 40])
    def test_a_spin_that_ends_amid_a_flood_loses_nothing(self, world: World, node: Node, end: int) -> None:
        """The next spin delivers the rest of the executor's batch."""
        heard: list[int] = []

        def until_the_end(message: Any) -> None:
            heard.append(message.data)
            if message.data == end:
                node.executor.shutdown()

        node.create_subscription(Int64, "t", until_the_end, 1000)
        published(node, 500, 1000)
        world.executor(node).spin()
        assert heard[: end + 1] == list(range(end + 1))
        world.spin_until(lambda: len(heard) == 500)
        assert heard == list(range(500))

    def test_destroying_amid_a_flood_ends_the_calls(self, world: World, node: Node) -> None:
        heard: list[int] = []

        def last(message: Any) -> None:
            heard.append(message.data)
            if message.data == 20:
                assert node.destroy_subscription(subscription)

        subscription = node.create_subscription(Int64, "t", last, 1000)
        ends: list[Any] = []
        node.create_subscription(String, "end", ends.append, 10)
        published(node, 500, 1000)
        node.create_publisher(String, "end", 10).publish(String())
        world.spin_until(lambda: ends and heard)
        world.spin_until(lambda: 20 in heard)
        assert heard == list(range(21))

    def test_a_shutdown_of_the_context_amid_a_flood(self, world: World, node: Node) -> None:
        heard: list[int] = []

        def last(message: Any) -> None:
            heard.append(message.data)
            if message.data == 20:
                rclpy.shutdown()

        node.create_subscription(Int64, "t", last, 1000)
        published(node, 500, 1000)
        rclpy.spin(node)
        assert heard == list(range(21))


class TestPublishing:
    def test_what_is_serialized_already(self, world: World, node: Node) -> None:
        heard: list[Any] = []
        node.create_subscription(String, "t", heard.append, 10)
        node.create_publisher(String, "t", 10).publish(serialize_message(String(data="as bytes")))
        world.spin_until(lambda: heard)
        assert heard == [String(data="as bytes")]

    def test_what_is_serialized_as_cdr(self, world: World, node: Node) -> None:
        heard: list[Any] = []
        node.create_subscription(String, "t", heard.append, 10)
        publisher = node.create_publisher(String, "t", 10)
        with pytest.raises(ValueError, match=r"no CDR message of std_msgs/msg/String"):
            publisher.publish(b"\0\1\0\0\xff\0\0\0cut")
        publisher.publish(b"\0\1\0\0\4\0\0\0cdr\0")
        world.spin_until(lambda: heard)
        assert heard == [String(data="cdr")]

    def test_a_message_of_another_class(self, node: Node) -> None:
        publisher = node.create_publisher(String, "t", 10)
        with pytest.raises(TypeError) as caught:
            publisher.publish(Int64())
        expected = "Expected <class 'std_msgs.msg._string.String'>, got <class 'std_msgs.msg._int64.Int64'>"
        assert str(caught.value) == expected
        with pytest.raises(TypeError, match="Expected"):
            publisher.publish("text")

    def test_a_message_whose_contents_went_wrong(self, world: World, node: Node) -> None:
        joints = message_class("sensor_msgs/msg/JointState")
        publisher = node.create_publisher(joints, "t", 10)
        message = joints(name=["a"])  # type: ignore[call-arg]
        message.name.append(1)  # type: ignore[attr-defined]
        with pytest.raises(TypeError, match="name"):
            publisher.publish(message)
        heard: list[Any] = []
        node.create_subscription(joints, "t", heard.append, 10)
        message.name.pop()  # type: ignore[attr-defined]
        publisher.publish(message)
        world.spin_until(lambda: heard)
        assert heard == [message]

    def test_a_message_of_a_class_below(self, world: World, node: Node) -> None:
        class Shout(String):
            __slots__ = ()

        heard: list[Any] = []
        node.create_subscription(String, "t", heard.append, 10)
        node.create_publisher(String, "t", 10).publish(Shout(data="HEY"))
        world.spin_until(lambda: heard)
        assert heard == [String(data="HEY")] and type(heard[0]) is String

    def test_one_object_changed_and_published_again(self, world: World, node: Node) -> None:
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
        publisher, message = node.create_publisher(Int64, "t", 10), Int64()
        for number in range(5):
            message.data = number
            publisher.publish(message)
        world.spin_until(lambda: len(heard) == 5)
        assert heard == [0, 1, 2, 3, 4]

    def test_from_many_threads_at_once(self, world: World, node: Node) -> None:
        """All arrive, and each thread's messages in order."""
        heard: list[int] = []
        node.create_subscription(Int64, "t", lambda message: heard.append(message.data), KEEP_ALL)
        publisher = node.create_publisher(Int64, "t", KEEP_ALL)
        threads, each = 8, 200

        def publish(thread: int) -> None:
            for number in range(each):
                publisher.publish(Int64(data=thread * each + number))

        with world.spinning(node):
            workers = [threading.Thread(target=publish, args=(index,)) for index in range(threads)]
            for worker in workers:
                worker.start()
            for worker in workers:
                worker.join()
            wait_until(lambda: len(heard) == threads * each)
        for index in range(threads):
            mine = [number for number in heard if number // each == index]
            assert mine == list(range(index * each, (index + 1) * each))

    def test_publishing_in_a_callback(self, world: World, node: Node) -> None:
        heard: list[int] = []
        publisher = node.create_publisher(Int64, "t", 10)

        def again(message: Any) -> None:
            heard.append(message.data)
            if message.data < 30:
                publisher.publish(Int64(data=message.data + 1))

        node.create_subscription(Int64, "t", again, 10)
        publisher.publish(Int64())
        world.spin_until(lambda: len(heard) == 31)
        assert heard == list(range(31))

    @pytest.mark.parametrize("is_encoded", [False, True])
    def test_keep_all_waits_for_room_and_gives_up(
        self, world: World, node: Node, monkeypatch: pytest.MonkeyPatch, is_encoded: bool
    ) -> None:
        other = world.node("other")
        heard: list[int] = []
        other.create_subscription(String, "t", lambda message: heard.append(len(message.data)), KEEP_ALL)
        publisher = node.create_publisher(String, "t", KEEP_ALL)
        big = String(data="x" * 1_000_000)
        message = serialize_message(big) if is_encoded else big
        monkeypatch.setattr(publishers, "ROOM_S", 0.2)
        sent = 0
        with pytest.raises(RuntimeError, match=r"failed to publish on '/t'.*keep_all keeps all"):
            while sent < 1000:
                publisher.publish(message)
                sent += 1
        assert 0 < sent < 1000
        monkeypatch.undo()
        with world.spinning(other):
            publisher.publish(String(data="last"))
            wait_until(lambda: heard and heard[-1] == 4)
        assert heard.count(1_000_000) >= sent

    def test_who_waits_for_room_goes_on_when_there_is_some(self, world: World, node: Node) -> None:
        other = world.node("other")
        heard: list[int] = []
        other.create_subscription(String, "t", lambda message: heard.append(len(message.data)), KEEP_ALL)
        publisher = node.create_publisher(String, "t", KEEP_ALL)

        def flood() -> None:
            for _ in range(200):
                publisher.publish(String(data="x" * 500_000))

        with in_thread(flood), world.spinning(other):
            wait_until(lambda: len(heard) == 200)

    def test_all_acked(self, node: Node) -> None:
        publisher = node.create_publisher(Int64, "t", 10)
        assert publisher.wait_for_all_acked()
        publisher.publish(Int64())
        assert publisher.wait_for_all_acked(Duration(seconds=10))


@pytest.mark.parametrize("change", ["callback", "filter"])
def test_a_callback_changes_what_comes_next(world: World, node: Node, change: str) -> None:
    """It takes effect at the next message, although several messages were taken at once."""
    first: list[int] = []
    second: list[int] = []

    def on_first(message: Any) -> None:
        first.append(message.data)
        if message.data != 20:
            return
        if change == "callback":
            subscription.callback = lambda message: second.append(message.data)
        else:
            subscription.set_content_filter("data >= 39", [])

    subscription = node.create_subscription(Int64, "t", on_first, 100)
    published(node, 40, 100)
    with world.spinning(node):
        wait_until(lambda: 39 in (*first, *second))
    expected = {"callback": (range(21), range(21, 40)), "filter": ((*range(21), 39), ())}
    assert (first, second) == tuple(list(numbers) for numbers in expected[change])


def test_a_filter_of_raw_messages_passes_none_that_is_no_message(world: World, node: Node) -> None:
    heard: list[bytes] = []
    options = ContentFilterOptions("data >= %0", ["3"])
    node.create_subscription(Int64, "t", heard.append, 10, raw=True, content_filter_options=options)
    publisher = node.create_publisher(Int64, "t", 10)
    publisher.publish(b"\xff")
    publisher.publish(Int64(data=4))
    world.spin_until(lambda: heard)
    assert [deserialize_message(one, Int64) for one in heard] == [Int64(data=4)]


@pytest.mark.parametrize("raw", [False, True])
def test_content_filters(world: World, raw: bool) -> None:
    """A filter applies from the moment it is set, with one argument and with two."""
    node = world.node()
    heard: list[Any] = []
    publisher = node.create_publisher(Int64, "t", 100)
    options = ContentFilterOptions("data >= %0", ["3"])
    subscription = node.create_subscription(
        Int64, "t", heard.append, 100, raw=raw, content_filter_options=options
    )
    assert subscription.is_cft_enabled and subscription.get_content_filter() == options

    def publish(*numbers: int) -> list[int]:
        heard.clear()
        for number in (*numbers, 99):
            publisher.publish(Int64(data=number))
        world.spin_until(lambda: heard and number_of(heard[-1]) == 99)
        return [number_of(one) for one in heard[:-1]]

    def number_of(message: Any) -> int:
        return int((deserialize_message(message, Int64) if raw else message).data)

    assert publish(1, 2, 3, 4) == [3, 4]
    subscription.set_content_filter("data BETWEEN 2 AND 3 OR data = 99", [])
    assert publish(1, 2, 3, 4) == [2, 3]
    with pytest.raises(RCLError, match="failed to set content filter: there is no parameter %0"):
        subscription.set_content_filter("data = %0", [])
    assert publish(1, 2, 3, 4) == [2, 3]
    subscription.set_content_filter("", [])
    assert not subscription.is_cft_enabled
    assert publish(1, 2, 3, 4) == [1, 2, 3, 4]
    with pytest.raises(RCLError, match="failed to get content filter"):
        subscription.get_content_filter()
