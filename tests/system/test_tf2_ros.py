"""tf2_ros: broadcasters, listeners, and waiting for transforms."""

from typing import Any

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.executors import MultiThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message, message_type
from bus_tf2.tf2_ros import (
    Buffer,
    LookupException,
    StaticTransformBroadcaster,
    StaticTransformListener,
    TransformBroadcaster,
    TransformListener,
    TransformRegistration,
    TypeException,
)
from rclpy_world import World, arguments, in_thread, world
from tf2_world import at, transform

__all__ = ["arguments", "world"]

NOW = Time()
LONG = Duration(seconds=30)


def here(buffer: Buffer, child: str, time: Time = NOW) -> float:
    return float(buffer.lookup_transform("world", child, time, LONG).transform.translation.x)


def test_what_is_sent_is_found(world: World) -> None:
    node, other = world.node(), world.node("other")
    buffer = Buffer()
    listener = TransformListener(buffer, node)
    TransformBroadcaster(other).sendTransform(transform("world", "robot", 1, (1, 0, 0)))
    TransformBroadcaster(other, QoSProfile(depth=5)).sendTransform(
        (transform("world", "one", 1, (2, 0, 0)), transform("world", "two", 1, (3, 0, 0)))
    )
    StaticTransformBroadcaster(other).sendTransform([transform("world", "still", 0, (4, 0, 0))])
    world.spin_until(
        lambda: all(buffer.can_transform("world", one, NOW) for one in ("robot", "two", "still"))
    )
    assert [here(buffer, child) for child in ("robot", "one", "two", "still")] == [1.0, 2.0, 3.0, 4.0]
    listener.unregister()
    assert not list(node.subscriptions)
    listener.unregister()


def test_a_late_listener_gets_all_static_ones(world: World) -> None:
    broadcaster = StaticTransformBroadcaster(world.node("other"))
    for number, child in enumerate(("a", "b", "a")):
        broadcaster.sendTransform(transform("world", child, 0, (number, 0, 0)))
    buffer = Buffer()
    listener = StaticTransformListener(buffer, world.node(), spin_thread=True)
    assert (here(buffer, "a"), here(buffer, "b")) == (2.0, 1.0)
    assert not hasattr(listener, "tf_sub")
    listener.unregister()


def test_waiting_in_a_thread(world: World) -> None:
    """A waiting look-up ends when the transform arrives, not at the next tick."""
    node = world.node()
    buffer = Buffer()
    listener = TransformListener(buffer, node, spin_thread=True)
    broadcaster = TransformBroadcaster(world.node("other"))
    found: list[float] = []
    with in_thread(lambda: found.append(here(buffer, "robot", at(5)))):
        for second in (4, 6):
            broadcaster.sendTransform(transform("world", "robot", second, (second, 0, 0)))
    assert found == [5.0]
    assert buffer.can_transform("world", "nobody", NOW, Duration(seconds=0.01)) == 0
    can, why = buffer.can_transform("world", "nobody", NOW, return_debug_tuple=True)
    assert (can, "frame does not exist" in why) == (0, True)
    with pytest.raises(LookupException, match="nobody"):
        buffer.lookup_transform("world", "nobody", NOW, Duration(seconds=0.01))
    assert buffer._new_data_callbacks == []
    listener.unregister()


def test_waiting_in_a_callback(world: World) -> None:
    """Two threads spin the node: the listener's callbacks have their own group."""
    node = world.node()
    buffer = Buffer(node=node)
    listener = TransformListener(buffer, node)
    broadcaster = TransformBroadcaster(world.node("other"))
    found: list[float] = []

    def look() -> None:
        timer.cancel()
        found.append(here(buffer, "robot"))

    timer = node.create_timer(0.0, look)
    with world.spinning(node, kind=lambda: MultiThreadedExecutor(2)):
        sender = world.node("sender")
        sender.create_timer(
            0.02, lambda: broadcaster.sendTransform(transform("world", "robot", 1, (7, 0, 0)))
        )
        world.spin_until(lambda: found, sender)
    assert found == [7.0]
    listener.unregister()


def test_awaiting(world: World) -> None:
    node, other = world.node(), world.node("other")
    buffer = Buffer()
    listener = TransformListener(buffer, node)
    broadcaster = TransformBroadcaster(other)
    found: list[Any] = []

    async def look() -> None:
        found.append(await buffer.lookup_transform_async("world", "robot", NOW))
        found.append(await buffer.lookup_transform_full_async("world", at(1), "robot", at(1), "world"))

    executor = world.executor(node)
    executor.create_task(look)
    given_up = buffer.wait_for_transform_async("world", "nobody", NOW)
    executor.spin_once(timeout_sec=0)
    assert not found
    broadcaster.sendTransform(transform("world", "robot", 1, (3, 0, 0)))
    world.spin_executor_until(lambda: len(found) == 2, executor)
    assert [one.transform.translation.x for one in found] == [3.0, 3.0]
    given_up.cancel()
    assert buffer._new_data_callbacks == []
    listener.unregister()


def test_a_listener_with_a_node_of_its_own(world: World) -> None:
    StaticTransformBroadcaster(world.node("other")).sendTransform(transform("world", "robot", 0, (1, 0, 0)))
    buffer = Buffer()
    listener = TransformListener(buffer, None, spin_thread=True)
    assert here(buffer, "robot") == 1.0
    node: Node = listener.node
    assert node.get_name().startswith("transform_listener_impl_")
    listener.unregister()
    node.destroy_node()


def test_the_frames_as_a_service(world: World) -> None:
    node = world.node()
    buffer = Buffer(node=node)
    buffer.set_transform_static(transform("world", "robot"), "me")
    client = node.create_client(message_type_of_frames(), "tf2_frames")
    future = client.call_async(message_type_of_frames().Request())
    world.spin_until(future.done)
    answer: Any = future.result()
    assert answer.frame_yaml == buffer.all_frames_as_yaml()


def message_type_of_frames() -> Any:
    from bus_ros.rosidl import service_class

    return service_class("tf2_msgs/srv/FrameGraph")


def test_time_that_jumps_back(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    """As if a recording starts again: earlier transforms belong to another time."""
    node = world.node()
    clock: Any = node.get_clock()
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(nanoseconds=20 * 10**9, clock_type=clock.clock_type))
    buffer = Buffer(node=node)
    buffer.set_transform(transform("world", "robot", 19), "me")
    buffer.set_transform_static(transform("robot", "arm"), "me")
    clock.set_ros_time_override(Time(nanoseconds=21 * 10**9, clock_type=clock.clock_type))
    assert buffer.can_transform("world", "robot", NOW)
    clock.set_ros_time_override(Time(nanoseconds=5 * 10**9, clock_type=clock.clock_type))
    assert not buffer.can_transform("world", "robot", NOW)
    assert buffer.can_transform("robot", "arm", NOW)
    assert "[tf2_buffer]: Detected jump back in time. Clearing tf buffer.\n" in capfd.readouterr().err


def test_registered_types() -> None:
    kind = message_type("geometry_msgs/msg/InertiaStamped")
    buffer = Buffer()
    buffer.set_transform_static(transform("world", "robot", 0, (1, 0, 0)), "me")
    stamped = message("geometry_msgs/msg/InertiaStamped")
    stamped.header.frame_id = "robot"
    with pytest.raises(TypeException, match="InertiaStamped'> is not loaded or supported"):
        buffer.transform(stamped, "world")
    TransformRegistration().add(kind, lambda one, place: (one, place.transform.translation.x))
    try:
        assert buffer.transform(stamped, "world") == (stamped, 1.0)
        assert buffer.transform_full(stamped, "world", NOW, "world") == (stamped, 1.0)
    finally:
        TransformRegistration._functions.pop(kind)
