"""Transforms point clouds into another frame's coordinates; imports NumPy for the first cloud."""

from typing import TYPE_CHECKING, Any

from bus_ros.sensor_msgs_py.point_cloud2 import rows_of
from bus_tf2.core.rotation import matrix
from bus_tf2.messages import message, message_type
from bus_tf2.tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

if TYPE_CHECKING:
    import numpy as np

__all__ = ["do_transform_cloud", "from_msg_msg", "to_msg_msg", "transform_points"]


def to_msg_msg(msg: Any) -> Any:
    return msg


def from_msg_msg(msg: Any) -> Any:
    return msg


def transform_points(point_cloud: Any, transform: Any) -> "np.ndarray[Any, Any]":
    """Points, an array of n x 3, by a Transform or a TransformStamped; a new array."""
    import numpy as np

    place = getattr(transform, "transform", transform)
    moved, turned = place.translation, place.rotation
    turn = np.array(matrix((turned.x, turned.y, turned.z, turned.w)))
    return np.asarray(np.asarray(point_cloud) @ turn.T + (moved.x, moved.y, moved.z))


def do_transform_cloud(cloud: Any, transform: Any) -> Any:
    """A PointCloud2 with fields x, y and z in the coordinates of the transform's frame; other fields stay.

    Raises ValueError if the cloud lacks one of the three, or if its data are shorter than it says.
    """
    import numpy as np

    data = bytearray(cloud.data)
    points = rows_of(cloud, data)
    if missing := [name for name in "xyz" if name not in (points.dtype.names or ())]:
        raise ValueError(f"the point cloud has no field {', '.join(map(repr, missing))}")
    places = np.stack([points[name].astype(np.float64) for name in "xyz"], axis=-1)
    found = transform_points(places, transform)
    for index, name in enumerate("xyz"):
        points[name] = found[..., index]
    return message(
        "sensor_msgs/msg/PointCloud2",
        header=message("std_msgs/msg/Header", stamp=cloud.header.stamp, frame_id=transform.header.frame_id),
        height=cloud.height,
        width=cloud.width,
        fields=cloud.fields,
        is_bigendian=cloud.is_bigendian,
        point_step=cloud.point_step,
        row_step=cloud.row_step,
        data=data,
        is_dense=cloud.is_dense,
    )


def _register() -> None:
    kind = message_type("sensor_msgs/msg/PointCloud2")
    TransformRegistration().add(kind, do_transform_cloud)
    ConvertRegistration().add_to_msg(kind, to_msg_msg)
    ConvertRegistration().add_from_msg(kind, from_msg_msg)


_register()
