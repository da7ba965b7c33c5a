"""Messages in the coordinates of another frame, by an explicit transform and by a buffer."""

import math
from typing import Any

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_ros.rclpy.time import Time
from bus_tf2 import tf2_geometry_msgs
from bus_tf2.messages import message, message_type
from bus_tf2.tf2_ros import Buffer
from rows import for_each
from tf2_world import transform, yaw

MOVE = transform("world", "robot", 3, (10, 20, 30), yaw(math.pi / 2))


def stamped(short: str, **fields: Any) -> Any:
    made = message(f"geometry_msgs/msg/{short}", **fields)
    made.header.frame_id = "robot"
    return made


def place(of: Any) -> tuple[float, ...]:
    return of.x, of.y, of.z


def vector(short: str, *parts: float) -> Any:
    return message(f"geometry_msgs/msg/{short}", **dict(zip("xyzw", map(float, parts), strict=False)))


def test_a_point_and_a_vector() -> None:
    point = tf2_geometry_msgs.do_transform_point(
        stamped("PointStamped", point=vector("Point", 1, 2, 3)), MOVE
    )
    assert place(point.point) == pytest.approx((8, 21, 33))
    assert point.header == MOVE.header
    turned = tf2_geometry_msgs.do_transform_vector3(
        stamped("Vector3Stamped", vector=vector("Vector3", 1, 2, 3)), MOVE
    )
    assert place(turned.vector) == pytest.approx((-2, 1, 3))
    assert MOVE.transform.translation.x == 10.0


@for_each("length", [1.0, 3.0])
def test_a_pose(length: float) -> None:
    pose = message("geometry_msgs/msg/Pose", position=vector("Point", 1, 0, 0))
    pose.orientation = vector("Quaternion", *(length * part for part in yaw(math.pi)))
    found = tf2_geometry_msgs.do_transform_pose(pose, MOVE)
    assert place(found.position) == pytest.approx((10, 21, 30))
    x, y, z, w = *place(found.orientation), found.orientation.w
    assert (x, y, -z, -w) == pytest.approx(yaw(1.5 * math.pi))
    assert w >= 0
    pose.orientation = vector("Quaternion", 0, 0, 0, 0)
    found = tf2_geometry_msgs.do_transform_pose(pose, MOVE)
    assert found.orientation.w == pytest.approx(math.cos(math.pi / 4))


def test_a_covariance() -> None:
    before = np.arange(36.0)
    after = np.array(tf2_geometry_msgs.transform_covariance(before, MOVE)).reshape(6, 6)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    both = np.block([[turn, np.zeros((3, 3))], [np.zeros((3, 3)), turn]])
    assert np.allclose(after, both @ before.reshape(6, 6) @ both.T)


def test_by_a_buffer() -> None:
    buffer = Buffer()
    buffer.set_transform_static(MOVE, "me")
    wrench = stamped("WrenchStamped")
    wrench.wrench.force.x = 1.0
    found = buffer.transform(wrench, "world")
    assert place(found.wrench.force) == pytest.approx((0, 1, 0))
    pose = stamped("PoseWithCovarianceStamped")
    pose.pose.covariance[0] = 4.0
    found = buffer.transform(pose, "world")
    assert place(found.pose.pose.position) == pytest.approx((10, 20, 30))
    assert found.pose.covariance[7] == pytest.approx(4.0)
    point = stamped("PointStamped")
    again = buffer.transform_full(point, "world", Time(), "world", new_type=type(point))
    assert place(again.point) == (10, 20, 30)
    assert again.header.frame_id == "world"
    assert tf2_geometry_msgs.PoseStamped is message_type("geometry_msgs/msg/PoseStamped")
    with pytest.raises(AttributeError, match=r"^module 'tf2_geometry_msgs' has no attribute 'Nothing'$"):
        _ = tf2_geometry_msgs.Nothing
