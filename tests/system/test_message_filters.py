"""message_filters in a node: messages of several topics that belong together by their stamps."""

from typing import Any

from bus_ros.message_filters import ApproximateTimeSynchronizer, Cache, Subscriber
from bus_ros.rclpy.time import Time
from bus_ros.rosidl import message_class
from rclpy_world import World, arguments, world

__all__ = ["arguments", "world"]

Temperature: Any = message_class("sensor_msgs/msg/Temperature")
FluidPressure: Any = message_class("sensor_msgs/msg/FluidPressure")


def stamped(kind: Any, milliseconds: int) -> Any:
    message = kind()
    message.header.stamp = Time(nanoseconds=milliseconds * 1_000_000).to_msg()
    return message


def test_two_topics(world: World) -> None:
    node, other = world.node(), world.node("other")
    inputs = [Subscriber(node, Temperature, "temp"), Subscriber(node, FluidPressure, "fluid", qos_profile=5)]
    assert [one.getTopic() for one in inputs] == ["temp", "fluid"]
    assert inputs[1].topic_name == "/fluid"
    assert (inputs[0].qos_profile.depth, inputs[1].qos_profile.depth) == (10, 5)
    synchronizer = ApproximateTimeSynchronizer(inputs, 10, 0.05)
    cache = Cache(inputs[0], 5)
    heard: list[tuple[Any, Any]] = []
    synchronizer.registerCallback(lambda temp, fluid: heard.append((temp, fluid)))
    temps = other.create_publisher(Temperature, "temp", 10)
    fluids = other.create_publisher(FluidPressure, "fluid", 10)
    for milliseconds in (1000, 2000, 3000):
        temps.publish(stamped(Temperature, milliseconds))
        fluids.publish(stamped(FluidPressure, milliseconds + 20))
    world.spin_until(lambda: len(heard) == 3)
    assert sorted((temp.header.stamp.sec, fluid.header.stamp.nanosec) for temp, fluid in heard) == [
        (1, 20_000_000),
        (2, 20_000_000),
        (3, 20_000_000),
    ]
    assert cache.getLast().header.stamp.sec == 3
    node.destroy_subscription(inputs[0].sub)
