"""Matches in the facade, and their events, by both routes."""

import threading
from typing import Any

import pytest

from bus_ros.rclpy import publisher as publishers
from bus_ros.rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSLivelinessChangedInfo,
    QoSPublisherMatchedInfo,
    QoSSubscriptionMatchedInfo,
    SubscriptionEventCallbacks,
)
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import (
    LivelinessPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
)
from bus_ros.rclpy.task import Future
from conftest import WAIT_S
from rclpy_world import Int64, Kind, World, arguments, every_kind, trigger, wait_until, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")


@pytest.fixture
def node(world: World) -> Node:
    return world.node()


def test_counts_change_without_spin(world: World, node: Node) -> None:
    publisher = node.create_publisher(Int64, "t", 10)
    assert publisher.get_subscription_count() == 0
    other = world.node("other")
    subscriptions = [other.create_subscription(Int64, "t", print, 10) for _ in range(2)]
    wait_until(lambda: publisher.get_subscription_count() == 2)
    other.destroy_subscription(subscriptions[0])
    wait_until(lambda: publisher.get_subscription_count() == 1)
    node.destroy_publisher(publisher)
    wait_until(lambda: subscriptions[1].get_publisher_count() == 0)


@pytest.mark.parametrize("is_first", [True, False], ids=["publisher first", "subscription first"])
def test_ends_of_one_program_count_at_once(
    world: World, node: Node, is_first: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Programs ask right after they have made both."""
    monkeypatch.setattr(publishers, "_READY_S", WAIT_S)
    other = world.node("other")
    if not is_first:
        other.create_subscription(Int64, "t", print, 10)
    publisher = node.create_publisher(Int64, "t", 10)
    if is_first:
        other.create_subscription(Int64, "t", print, 10)
    assert publisher.get_subscription_count() == 1


@every_kind
def test_a_callback_counts(world: World, node: Node, kind: Kind, monkeypatch: pytest.MonkeyPatch) -> None:
    """The executor's thread then runs the event loop inside the callback, or waits for the one that does."""
    monkeypatch.setattr(publishers, "_READY_S", WAIT_S)
    counted: list[int] = []

    def count() -> None:
        other.create_subscription(Int64, "t", print, 10)
        counted.append(publisher.get_subscription_count())

    other = world.node("other")
    publisher = node.create_publisher(Int64, "t", 10)
    timer = node.create_timer(0.001, count)
    with world.spinning(node, kind=kind):
        wait_until(lambda: len(counted) >= 3)
        timer.cancel()
    assert counted[:3] == [1, 2, 3]


def test_best_effort_does_not_match_reliable(world: World, node: Node) -> None:
    said: list[tuple[str, Any]] = []
    publisher = node.create_publisher(
        Int64,
        "t",
        qos_profile_sensor_data,
        event_callbacks=PublisherEventCallbacks(incompatible_qos=lambda info: said.append(("p", info))),
    )
    node.create_subscription(
        Int64,
        "t",
        lambda message: said.append(("message", message)),
        QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE),
        event_callbacks=SubscriptionEventCallbacks(incompatible_qos=lambda info: said.append(("s", info))),
    )
    publisher.publish(Int64())
    world.spin_until(lambda: len(said) == 2)
    infos = dict(said)
    assert set(infos) == {"p", "s"}
    assert all(one.last_policy_kind == QoSPolicyKind.RELIABILITY for one in infos.values())
    assert publisher.get_subscription_count() == 0


def test_matches_are_told(world: World, node: Node) -> None:
    said: list[Any] = []
    publisher = node.create_publisher(
        Int64, "t", 10, event_callbacks=PublisherEventCallbacks(matched=said.append)
    )
    subscription = node.create_subscription(
        Int64, "t", print, 10, event_callbacks=SubscriptionEventCallbacks(matched=said.append)
    )
    world.spin_until(lambda: len(said) == 2)
    node.destroy_subscription(subscription)
    world.spin_until(lambda: len(said) == 3)
    assert sorted(said[:2], key=lambda one: type(one).__name__) == [
        QoSPublisherMatchedInfo(1, 1, 1, 1),
        QoSSubscriptionMatchedInfo(1, 1, 1, 1),
    ]
    assert said[2] == QoSPublisherMatchedInfo(1, 0, 0, -1)
    assert publisher.get_subscription_count() == 0


def test_missed_deadlines_are_told(world: World, node: Node) -> None:
    missed: dict[str, list[Any]] = {"p": [], "s": []}
    qos = QoSProfile(depth=1, deadline=Duration(seconds=0.02))
    publisher = node.create_publisher(
        Int64, "t", qos, event_callbacks=PublisherEventCallbacks(deadline=missed["p"].append)
    )
    node.create_subscription(
        Int64,
        "t",
        lambda message: None,
        qos,
        event_callbacks=SubscriptionEventCallbacks(deadline=missed["s"].append),
    )
    publisher.publish(Int64())
    world.spin_until(lambda: len(missed["p"]) >= 2 and len(missed["s"]) >= 2)
    assert [one.total_count for one in missed["p"][:2]] == [1, 2]


def test_liveliness_is_told_and_can_be_asserted(world: World, node: Node) -> None:
    qos = QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=0.05),
    )
    lost: list[Any] = []
    changed: list[Any] = []
    publisher = node.create_publisher(
        Int64, "t", qos, event_callbacks=PublisherEventCallbacks(liveliness=lost.append)
    )
    node.create_subscription(
        Int64, "t", print, qos, event_callbacks=SubscriptionEventCallbacks(liveliness=changed.append)
    )
    publisher.assert_liveliness()
    world.spin_until(lambda: lost and any(one.not_alive_count == 1 for one in changed))
    count = len(changed)
    publisher.assert_liveliness()
    world.spin_until(lambda: any(one.alive_count == 1 for one in changed[count:]))
    assert all(isinstance(one, QoSLivelinessChangedInfo) for one in changed)


def test_events_come_in_worker_threads_too(world: World, node: Node) -> None:
    said: list[str] = []
    group = ReentrantCallbackGroup()
    node.create_publisher(Int64, "t", 10)
    with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
        node.create_subscription(
            Int64,
            "t",
            print,
            10,
            callback_group=group,
            event_callbacks=SubscriptionEventCallbacks(
                matched=lambda info: said.append(threading.current_thread().name)
            ),
        )
        wait_until(lambda: said)
    assert said[0].startswith("rclpy executor")


@every_kind
def test_async_callbacks_of_events_are_awaited(world: World, node: Node, kind: Kind) -> None:
    """They may also wait for something."""
    told: list[Any] = []
    gate: Future[None] = Future()

    async def tell(info: Any) -> None:
        told.append(type(info))
        await gate
        told.append("end")

    with world.spinning(node, kind=kind):
        node.create_publisher(Int64, "t", 10, event_callbacks=PublisherEventCallbacks(matched=tell))
        node.create_subscription(Int64, "t", print, 10)
        wait_until(lambda: told)
        gate.set_result(None)
        wait_until(lambda: len(told) == 2)
    assert told == [QoSPublisherMatchedInfo, "end"]


def test_events_are_called_in_the_group_of_their_endpoint(world: World, node: Node) -> None:
    """So they never run at the same time as the subscription's callback."""
    told: list[Any] = []
    groups = [MutuallyExclusiveCallbackGroup() for _ in range(2)]

    def tell(group: Any) -> None:
        wait_until(lambda: not group.can_execute(None))  # the executor notes it while it hands over the call
        told.append(group)

    with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
        publisher = node.create_publisher(
            Int64,
            "t",
            10,
            callback_group=groups[0],
            event_callbacks=PublisherEventCallbacks(matched=lambda _: tell(groups[0])),
        )
        node.create_subscription(
            Int64,
            "t",
            print,
            10,
            callback_group=groups[1],
            event_callbacks=SubscriptionEventCallbacks(matched=lambda _: tell(groups[1])),
        )
        wait_until(lambda: len(told) == 2)
    assert {*told} == {*groups}
    assert {one.callback_group for one in publisher.event_handlers} == {groups[0]}


def test_events_that_wait_are_one(world: World, node: Node) -> None:
    """A kind of event is a state: its callback gets the changes since its last call."""
    said: list[Any] = []
    publisher = node.create_publisher(
        Int64, "t", 10, event_callbacks=PublisherEventCallbacks(matched=said.append)
    )
    other = world.node("other")
    subscriptions = [other.create_subscription(Int64, "t", print, 10) for _ in range(3)]
    wait_until(lambda: len(publisher.native.matches) == 3)
    other.destroy_subscription(subscriptions[0])
    wait_until(lambda: publisher.native.matches and len(publisher.native.matches) == 2)
    world.spin_until(lambda: said)
    other.destroy_subscription(subscriptions[1])
    world.spin_until(lambda: len(said) == 2)
    assert said == [QoSPublisherMatchedInfo(3, 3, 2, 2), QoSPublisherMatchedInfo(3, 0, 1, -1)]


def test_no_events_after_the_end_of_an_endpoint(world: World, node: Node) -> None:
    said: list[Any] = []
    publisher = node.create_publisher(
        Int64, "t", 10, event_callbacks=PublisherEventCallbacks(matched=said.append)
    )
    subscription = node.create_subscription(
        Int64, "t", print, 10, event_callbacks=SubscriptionEventCallbacks(matched=said.append)
    )
    wait_until(lambda: len(node.waiting) >= 2)
    node.destroy_publisher(publisher)
    node.destroy_subscription(subscription)
    done: list[None] = []
    trigger(node, lambda: done.append(None))
    world.spin_until(lambda: done)
    assert said == []
