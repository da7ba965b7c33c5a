"""Point clouds in the coordinates of another frame; NumPy is imported when the first one comes."""

from typing import TYPE_CHECKING, Any

from bus_tf2.core.rotation import matrix
from bus_tf2.messages import message, message_type
from bus_tf2.tf2_ros.buffer_interface import ConvertRegistration, TransformRegistration

if TYPE_CHECKING:
    import numpy as np

__all__ = ["do_transform_cloud", "from_msg_msg", "to_msg_msg", "transform_points"]

_FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's names of PointField's types."""


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
    """A PointCloud2 whose fields x, y and z are in the coordinates of the transform's frame; the others stay.

    Raises ValueError where the cloud lacks one of the three, or its data are shorter than it says.
    """
    import numpy as np

    formats = {field.name: (_FORMATS[field.datatype], field.offset) for field in cloud.fields}
    if missing := [name for name in "xyz" if name not in formats]:
        raise ValueError(f"the point cloud has no field {', '.join(map(repr, missing))}")
    order = ">" if cloud.is_bigendian else "<"
    kind = np.dtype(
        {
            "names": list("xyz"),
            "formats": [order + formats[name][0] for name in "xyz"],
            "offsets": [formats[name][1] for name in "xyz"],
            "itemsize": cloud.point_step,
        }
    )
    data = bytearray(cloud.data)
    needed = (cloud.height - 1) * cloud.row_step + cloud.width * cloud.point_step if cloud.height else 0
    if len(data) < needed:
        raise ValueError(f"the point cloud has {len(data)} bytes of data, and says {needed}")
    points = np.ndarray((cloud.height, cloud.width), kind, data, strides=(cloud.row_step, cloud.point_step))
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
