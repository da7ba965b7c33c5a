"""Messages of rosidl's classes on topics, together with messages of the native classes."""

from typing import Any

import pytest

import bus
from bus.errors import MessageTypeError
from bus.types.classes import message_class as native_class
from bus.types.large_fields import LONG_BYTES
from bus_ros.rosidl import message_class
from semantics import node

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


def cls(name: str) -> Any:
    return message_class(name)


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("std_msgs/msg/String", {"data": "hi"}),
        ("sensor_msgs/msg/Image", {"data": bytes(range(256)) * (LONG_BYTES // 128)}),
        ("sensor_msgs/msg/JointState", {"name": ["a"], "position": [1.0, 2.0]}),
        ("std_srvs/srv/SetBool_Request", {"data": True}),
    ],
)
async def test_both_kinds_of_classes_hear_each_other(
    node: bus.Node, name: str, fields: dict[str, Any]
) -> None:
    ours, native = cls(name), native_class(name)
    of_ours = await node.create_subscription(ours, "t", 10)
    of_native = await node.create_subscription(native, "t", 10)
    from_ours = await node.create_publisher(ours, "t", 10)
    from_native: Any = await node.create_publisher(native, "t", 10)
    for publisher, message in ((from_ours, ours(**fields)), (from_native, native(**fields))):
        await publisher.wait_for_subscriptions(2)
        publisher.publish(message)
        assert await anext(of_ours) == ours(**fields)
        assert await anext(of_native) == native(**fields)


async def test_a_message_may_be_changed_and_published_again(node: bus.Node) -> None:
    subscription = await node.create_subscription(cls("sensor_msgs/msg/LaserScan"), "t", 10)
    publisher = await node.create_publisher(cls("sensor_msgs/msg/LaserScan"), "t", 10)
    message = cls("sensor_msgs/msg/LaserScan")()
    for number in range(3):
        message.ranges.append(float(number))
        publisher.publish(message)
    assert [list((await anext(subscription)).ranges) for _ in range(3)] == [
        [0.0],
        [0.0, 1.0],
        [0.0, 1.0, 2.0],
    ]


async def test_what_can_not_be_published_is_said(node: bus.Node) -> None:
    publisher = await node.create_publisher(cls("sensor_msgs/msg/JointState"), "t", 10)
    message = cls("sensor_msgs/msg/JointState")()
    message.name.append(5)
    with pytest.raises(
        MessageTypeError, match=r"The 'name' field must be a set or sequence .* at `\$\.name`"
    ):
        publisher.publish(message)
    with pytest.raises(MessageTypeError, match=r"expected a .*JointState, got str"):
        publisher.publish("x")
    assert publisher.statistics().published == 0
