"""Messages handed directly to an executor that only waits for them: the results are the same."""

from typing import Any

import pytest

from bus_ros.rclpy.impl.handover import Handover
from neighbours import wait_until
from rclpy_world import Int64, World, arguments, arrived, in_thread, is_waiting, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")

COUNT = 50


@pytest.fixture
def handed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of the directly handed messages."""
    numbers: list[int] = []
    handed = Handover.receive

    def receive(self: Any, message: Any) -> None:
        numbers.append(message.data)
        handed(self, message)

    monkeypatch.setattr(Handover, "receive", receive)
    return numbers


def publish_singly(publisher: Any, numbers: range, heard: list[int], executor: Any) -> None:
    """Publishes each one when the executor is idle."""
    for number in numbers:
        wait_until(lambda: is_waiting(executor))
        publisher.publish(Int64(data=number))
        wait_until(lambda number=number: len(heard) > number)


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_a_lone_message_is_handed_over(world: World, handed: list[int]) -> None:
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    subscription = node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
    publisher = other.create_publisher(Int64, "t", 10)
    with world.spinning(node) as executor:
        publish_singly(publisher, range(COUNT), heard, executor)
    assert heard == list(range(COUNT))
    assert len(handed) > COUNT / 2
    assert arrived(subscription) == COUNT


def test_many_subscriptions_keep_their_order(world: World) -> None:
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    publishers = []
    for topic in ("a", "b", "c"):
        node.create_subscription(Int64, topic, lambda message: heard.append(message.data), 1000)
        publishers.append(other.create_publisher(Int64, topic, 1000))
    with world.spinning(node):
        for number in range(300):
            publishers[number % 3].publish(Int64(data=number))
        wait_until(lambda: len(heard) == 300)
    assert all(
        heard_of == sorted(heard_of) for heard_of in ([n for n in heard if n % 3 == k] for k in range(3))
    )
    assert sorted(heard) == list(range(300))


def test_what_comes_during_a_callback_counts_in_the_depth(world: World) -> None:
    node, other = world.node(), world.node("other")
    publisher = other.create_publisher(Int64, "t", 1)
    heard: list[int] = []

    def callback(message: Any) -> None:
        heard.append(message.data)
        if message.data % 10 == 0:
            for number in range(1, 10):
                publisher.publish(Int64(data=message.data + number))
            wait_until(lambda: arrived(subscription) == message.data + 10)

    subscription = node.create_subscription(Int64, "t", callback, 1)
    with world.spinning(node) as executor:
        for turn in range(5):
            wait_until(lambda: is_waiting(executor))
            publisher.publish(Int64(data=10 * turn))
            wait_until(lambda turn=turn: heard[-1:] == [10 * turn + 9])
    assert heard == [number for turn in range(5) for number in (10 * turn, 10 * turn + 9)]


def test_another_executor_goes_on(world: World, handed: list[int]) -> None:
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
    publisher = other.create_publisher(Int64, "t", 10)
    with world.spinning(node) as first:
        publish_singly(publisher, range(10), heard, first)
        with world.spinning(node) as second:
            assert node.executor is second
            for number in range(10, 20):
                publisher.publish(Int64(data=number))
                wait_until(lambda number=number: len(heard) > number)
        number_handed = len(handed)
        publisher.publish(Int64(data=20))  # no executor has the node
        first.add_node(node)
        wait_until(lambda: len(heard) > 20)
        publish_singly(publisher, range(21, 30), heard, first)
    assert heard == list(range(30))
    assert len(set(handed)) == len(handed) >= number_handed


def test_an_exception_loses_no_other_message(world: World) -> None:
    heard: list[int] = []
    node, other = world.node(), world.node("other")

    def callback(message: Any) -> None:
        heard.append(message.data)
        if message.data % 5 == 0:
            publisher.publish(Int64(data=message.data + 1))
            raise ValueError(message.data)
        if message.data < 24:
            publisher.publish(Int64(data=message.data + 1))

    node.create_subscription(Int64, "t", callback, 10)
    publisher = other.create_publisher(Int64, "t", 10)
    executor = world.executor(node)
    publisher.publish(Int64(data=0))
    raised = []
    while len(heard) < 25:
        try:
            executor.spin_once(timeout_sec=1)
        except ValueError as error:
            raised.append(error.args[0])
    assert heard == list(range(25))
    assert raised == [0, 5, 10, 15, 20]


def test_an_interrupt_keeps_what_was_handed_over(
    route: str, world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    subscription = node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
    publisher = other.create_publisher(Int64, "t", 10)
    executor = world.executor(node)
    publisher.publish(Int64(data=0))
    world.spin_executor_until(lambda: heard, executor)
    loop, handed = executor._engine.loop, Handover.receive

    def receive(self: Any, message: Any) -> None:
        handed(self, message)
        loop.is_interrupted = True  # as a signal's handler does

    monkeypatch.setattr(Handover, "receive", receive)
    subscription.leave()
    subscription._on_message()

    def publish() -> None:
        publish_singly(publisher, range(1, COUNT), heard, executor)

    interrupts = 0
    with in_thread(publish):
        while len(heard) < COUNT:
            before = len(heard)
            try:
                executor.spin_once(timeout_sec=1)
            except KeyboardInterrupt:
                interrupts += 1
                assert len(heard) == before
    assert heard == list(range(COUNT))
    assert (interrupts > 0) == (route == "shm")


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_one_that_waits_for_messages_alone_is_given_up(world: World, handed: list[int]) -> None:
    """Any other event ends this way of waiting: another topic, a task, another executor, the end."""
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    subscription = node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10)
    node.create_subscription(Int64, "u", lambda message: heard.append(message.data), 10)
    lone, second = (other.create_publisher(Int64, topic, 10) for topic in "tu")
    with world.spinning(node) as executor:
        publish_singly(lone, range(10), heard, executor)
        assert executor.lone is subscription._handover
        second.publish(Int64(data=10))
        wait_until(lambda: len(heard) > 10)
        publish_singly(lone, range(11, 20), heard, executor)
        executor.create_task(heard.append, 20)
        wait_until(lambda: len(heard) > 20)
        publish_singly(lone, range(21, 30), heard, executor)
        with world.spinning(node):
            for number in range(30, 40):
                lone.publish(Int64(data=number))
                wait_until(lambda number=number: len(heard) > number)
    assert heard == list(range(40))
    assert len(set(handed)) == len(handed)


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_executors_that_pass_a_node_to_and_fro_keep_the_order(world: World) -> None:
    """One executor may have taken a message directly just before the other one gets the node."""
    heard: list[int] = []
    node, other = world.node(), world.node("other")
    node.create_subscription(Int64, "t", lambda message: heard.append(message.data), 10_000)
    publisher = other.create_publisher(Int64, "t", 10_000)
    with world.spinning(node) as first, world.spinning() as second:

        def publish() -> None:
            for number in range(2000):
                publisher.publish(Int64(data=number))
                if number % 7 == 0:
                    wait_until(lambda number=number: len(heard) > number)

        with in_thread(publish):
            while len(heard) < 2000:
                for executor in (second, first):
                    executor.add_node(node)
                    goal = min(len(heard) + 3, 2000)
                    wait_until(lambda goal=goal: len(heard) >= goal)
    assert heard == list(range(2000))
