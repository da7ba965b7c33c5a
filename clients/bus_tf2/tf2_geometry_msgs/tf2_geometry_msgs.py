"""Transforms geometry messages into another frame's coordinates, and registers the functions for buffers.

Owns: the functions of each type, and their registrations. Importing this module makes the registrations.
Plain Python, because for one message it is quicker than NumPy.
"""

from typing import Any

from bus_tf2.core.rotation import Quaternion, Transform, Vector, composed, dot, matrix, normal, rotate
from bus_tf2.messages import message, message_type
from bus_tf2.tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

__all__ = [
    "do_transform_point",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "do_transform_wrench",
    "from_msg_msg",
    "to_msg_msg",
    "transform_covariance",
]

_TYPES = (
    "PointStamped",
    "Pose",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "TransformStamped",
    "Vector3Stamped",
)
_NONE = 1e-16
"""A quaternion that is shorter, squared, is no turn."""


def to_msg_msg(msg: Any) -> Any:
    return msg


def from_msg_msg(msg: Any) -> Any:
    return msg


def do_transform_point(point: Any, transform: Any) -> Any:
    """A PointStamped in the coordinates of the transform's frame."""
    place = composed(_read(transform), (_vector(point.point), (0.0, 0.0, 0.0, 1.0)))[0]
    return _stamped("PointStamped", transform, point=_of("Point", place))


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """A Vector3Stamped, which only turns."""
    turned = rotate(_read(transform)[1], _vector(vector3.vector))
    return _stamped("Vector3Stamped", transform, vector=_of("Vector3", turned))


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """A Pose, without a header."""
    place, (x, y, z, w) = composed(_read(transform), (_vector(pose.position), _turn(pose.orientation)))
    sign = -1.0 if w < 0 else 1.0
    orientation = message("geometry_msgs/msg/Quaternion", x=sign * x, y=sign * y, z=sign * z, w=sign * w)
    return message("geometry_msgs/msg/Pose", position=_of("Point", place), orientation=orientation)


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """A PoseStamped."""
    return _stamped("PoseStamped", transform, pose=do_transform_pose(pose.pose, transform))


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """A PoseWithCovarianceStamped; the covariance turns with it."""
    made = _stamped("PoseWithCovarianceStamped", transform)
    made.pose.pose = do_transform_pose(pose.pose.pose, transform)
    made.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    return made


def do_transform_wrench(wrench: Any, transform: Any) -> Any:
    """A WrenchStamped: its force and its torque turn."""
    turn = _read(transform)[1]
    made = _stamped("WrenchStamped", transform)
    for name in ("force", "torque"):
        setattr(made.wrench, name, _of("Vector3", rotate(turn, _vector(getattr(wrench.wrench, name)))))
    return made


def transform_covariance(cov_in: Any, transform: Any) -> Any:
    """36 numbers, row by row, of three places and three turns; returned as a message's field holds them."""
    turn = matrix(_read(transform)[1])
    made = message("geometry_msgs/msg/PoseWithCovariance").covariance
    for row in (0, 3):
        for column in (0, 3):
            block = [[cov_in[6 * (row + i) + column + j] for j in range(3)] for i in range(3)]
            half = [[sum(turn[i][k] * block[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
            for i in range(3):
                for j in range(3):
                    made[6 * (row + i) + column + j] = sum(half[i][k] * turn[j][k] for k in range(3))
    return made


def _read(stamped: Any) -> Transform:
    return _vector(stamped.transform.translation), _turn(stamped.transform.rotation)


def _vector(of: Any) -> Vector:
    return of.x, of.y, of.z


def _turn(of: Any) -> Quaternion:
    q = (of.x, of.y, of.z, of.w)
    return normal(q) if dot(q, q) > _NONE else (0.0, 0.0, 0.0, 1.0)


def _of(short: str, place: Vector) -> Any:
    return message(f"geometry_msgs/msg/{short}", x=place[0], y=place[1], z=place[2])


def _stamped(short: str, transform: Any, **fields: Any) -> Any:
    return message(f"geometry_msgs/msg/{short}", header=transform.header, **fields)


def _register() -> None:
    functions = {
        "PointStamped": do_transform_point,
        "Vector3Stamped": do_transform_vector3,
        "PoseStamped": do_transform_pose_stamped,
        "PoseWithCovarianceStamped": do_transform_pose_with_covariance_stamped,
        "WrenchStamped": do_transform_wrench,
    }
    convert = ConvertRegistration()
    for short, function in functions.items():
        kind = message_type(f"geometry_msgs/msg/{short}")
        TransformRegistration().add(kind, function)
        convert.add_to_msg(kind, to_msg_msg)
        convert.add_from_msg(kind, from_msg_msg)


_register()


def __getattr__(name: str) -> Any:
    """Message classes that programs take from here: ROS 2's module has imported them."""
    if name in _TYPES:
        return message_type(f"geometry_msgs/msg/{name}")
    raise AttributeError(f"module 'tf2_geometry_msgs' has no attribute {name!r}")
