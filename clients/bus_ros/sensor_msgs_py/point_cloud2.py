"""Reads points from a PointCloud2 and makes one, as `sensor_msgs_py.point_cloud2` of ROS 2 Jazzy.

Must not know topics. Clouds may be of any class with the fields of sensor_msgs/msg/PointCloud2.
"""

import sys
from array import array
from collections import namedtuple
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from bus_ros.extras import extra
from bus_ros.rosidl import message_class
from bus_ros.sensor_msgs_py.numpy_compat import structured_to_unstructured, unstructured_to_structured

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "DUMMY_FIELD_PREFIX",
    "Header",
    "PointCloud2",
    "PointField",
    "create_cloud",
    "create_cloud_xyz32",
    "dtype_from_fields",
    "read_points",
    "read_points_list",
    "read_points_numpy",
]

DUMMY_FIELD_PREFIX = "unnamed_field"
"""Prefix of the names of unnamed fields, followed by `_` and their index."""

_FORMATS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's names of PointField's datatypes."""
_FLOAT32 = 7
_MOST_COLUMNS = 1 << 16
"""Limit for the values of one point; a message can announce 2^32, which would take NumPy minutes."""


def read_points(
    cloud: Any,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: "Iterable[int] | np.ndarray[Any, Any] | None" = None,
    reshape_organized_cloud: bool = False,
) -> "np.ndarray[Any, Any]":
    """The points as an array with a field for each of `field_names`, or for all fields.

    The array is a view of the cloud's data if they are in this machine's byte order and have no padding
    between rows: writing to the array changes the message. `skip_nans` leaves out points with a NaN in one of
    the fields, unless `is_dense` says that there are none. `uvs`: only the points with these indices.
    `reshape_organized_cloud`: in two dimensions, `width` x `height`, as in ROS 2.

    Raises AssertionError with ROS 2's texts for anything but a cloud, and for missing, repeated or empty
    fields; ValueError if data are shorter than the cloud announces, or an organized cloud lacks points.
    """
    np = _numpy()
    points = _all_points(cloud)
    if field_names is not None:
        wanted = list(field_names)
        if not set(wanted) <= set(points.dtype.names or ()):
            raise AssertionError("Requests field is not in the fields of the PointCloud!")
        points = points[wanted]
    if not points.dtype.isnative:
        points = points.astype(points.dtype.newbyteorder("="))
    if skip_nans and not cloud.is_dense:
        keep = np.ones(len(points), dtype=bool)
        for name in points.dtype.names or ():
            keep &= ~np.isnan(points[name])
        points = points[keep]
    if uvs is not None:
        points = points[uvs if isinstance(uvs, np.ndarray) else np.fromiter(uvs, int)]
    if reshape_organized_cloud and cloud.height > 1:
        if len(points) != cloud.width * cloud.height:
            raise ValueError(
                f"{len(points)} of {cloud.width} x {cloud.height} points can't be organized: "
                "reshape_organized_cloud goes with neither skip_nans nor uvs"
            )
        points = points.reshape(cloud.width, cloud.height)
    return points


def read_points_numpy(
    cloud: Any,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: "Iterable[int] | np.ndarray[Any, Any] | None" = None,
    reshape_organized_cloud: bool = False,
) -> "np.ndarray[Any, Any]":
    """As `read_points`, as plain numbers with a column for each field: these must have one datatype.

    Raises AssertionError if they have several, and as `read_points`.
    """
    wanted = None if field_names is None else list(field_names)
    kinds = {field.datatype for field in cloud.fields if wanted is None or field.name in wanted}
    if len(kinds) > 1:
        raise AssertionError("All fields need to have the same datatype. Use `read_points()` otherwise.")
    points = read_points(cloud, wanted, skip_nans, uvs, reshape_organized_cloud)
    return structured_to_unstructured(points)


def read_points_list(
    cloud: Any,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: "Iterable[int] | np.ndarray[Any, Any] | None" = None,
) -> list[NamedTuple]:
    """As `read_points`, as a list of named tuples, with numbers of Python. Much slower than an array."""
    points = read_points(cloud, field_names, skip_nans, uvs)
    point = namedtuple("Point", points.dtype.names or ())  # type: ignore[misc]
    return [point(*values) for values in points.tolist()]


def dtype_from_fields(fields: Iterable[Any], point_step: int | None = None) -> "np.dtype[Any]":
    """NumPy's type of a point: a field with a `count` of 2 or more becomes `name_0`, `name_1`, ...

    `point_step`: bytes from one point to the next; None: to the end of the last field. Raises AssertionError
    for a count of 0 and for a repeated name. Raises ValueError for an unknown datatype, for fields beyond
    `point_step`, and for more than 65,536 values.
    """
    names: list[str] = []
    formats: list[str] = []
    offsets: list[int] = []
    order = "<" if sys.byteorder == "little" else ">"
    for index, field in enumerate(fields):
        name = field.name or f"{DUMMY_FIELD_PREFIX}_{index}"
        if field.datatype not in _FORMATS:
            raise ValueError(f"field '{name}' has the datatype {field.datatype}: there are 1 to 8")
        if not field.count:
            raise AssertionError("Can't process fields with count = 0.")
        kind = _FORMATS[field.datatype]
        end = field.offset + field.count * int(kind[1])
        if point_step is not None and end > point_step:
            raise ValueError(f"field '{name}' ends at byte {end}: a point has {point_step} bytes")
        if len(names) + field.count > _MOST_COLUMNS:
            raise ValueError(
                f"field '{name}' has a count of {field.count}: a point has {_MOST_COLUMNS} at most"
            )
        for part in range(field.count):
            names.append(f"{name}_{part}" if field.count > 1 else name)
            formats.append(kind if kind[1] == "1" else order + kind)
            offsets.append(field.offset + part * int(kind[1]))
    if len(set(names)) < len(names):
        raise AssertionError("Duplicate field names are not allowed!")
    parts: dict[str, Any] = {"names": names, "formats": formats, "offsets": offsets}
    if point_step is not None:
        parts["itemsize"] = point_step
    return _numpy().dtype(parts)  # type: ignore[no-any-return]


def create_cloud(header: Any, fields: Iterable[Any], points: Any, point_step: int | None = None) -> Any:
    """A PointCloud2 from points: a structured array, an array with a column for each field, or tuples.

    An array of points in two dimensions, `width` x `height`, makes an organized cloud. `point_step`: bytes
    from one point to the next; None: as in a structured array, or to the end of the last field. Raises
    AssertionError with ROS 2's texts if points and fields don't fit.
    """
    np = _numpy()
    fields = list(fields)
    kind = dtype_from_fields(fields, point_step)
    if not isinstance(points, np.ndarray):
        points = np.array([tuple(one) for one in points], dtype=kind)
    elif points.dtype.names is None:
        if len({field.datatype for field in fields}) > 1:
            raise AssertionError(
                "All fields need to have the same datatype. "
                "Pass a structured NumPy array with multiple dtypes otherwise."
            )
        points = unstructured_to_structured(points, dtype=kind)
    else:
        if point_step is None and points.dtype.itemsize > kind.itemsize:
            kind = dtype_from_fields(fields, points.dtype.itemsize)
        if points.dtype != kind:
            raise AssertionError(
                "PointFields and structured NumPy array dtype do not match for all fields! "
                "Check their field order, names and types."
            )
    if points.ndim > 2:
        raise AssertionError(
            "Too many dimensions for organized cloud! "
            "Points can only be organized in max. two dimensional space"
        )
    width, height = points.shape if points.ndim == 2 else (len(points), 1)
    step = points.dtype.itemsize
    data = array("B")
    data.frombytes(np.ascontiguousarray(points).view(np.uint8) if points.size else b"")
    cloud: Any = message_class("sensor_msgs/msg/PointCloud2")
    return cloud(
        header=header,
        height=height,
        width=width,
        is_dense=False,
        is_bigendian=sys.byteorder != "little",
        fields=fields,
        point_step=step,
        row_step=step * width,
        data=data,
    )


def create_cloud_xyz32(header: Any, points: Any) -> Any:
    """A PointCloud2 with x, y and z in 32 bits; as `create_cloud`."""
    field: Any = message_class("sensor_msgs/msg/PointField")
    fields = [
        field(name=name, offset=4 * index, datatype=_FLOAT32, count=1) for index, name in enumerate("xyz")
    ]
    return create_cloud(header, fields, points)


def rows_of(cloud: Any, data: Any) -> "np.ndarray[Any, Any]":
    """A view of `data` with the cloud's layout: `height` x `width` points in the cloud's byte order.

    Raises AssertionError and ValueError as `read_points`.
    """
    if not all(hasattr(cloud, name) for name in ("fields", "point_step", "row_step", "is_bigendian")):
        raise AssertionError("Cloud is not a sensor_msgs.msg.PointCloud2")
    kind = dtype_from_fields(cloud.fields, cloud.point_step)
    if cloud.is_bigendian != (sys.byteorder == "big"):
        kind = kind.newbyteorder()
    width, height, step = cloud.width, cloud.height, cloud.point_step
    # Some senders leave row_step 0, and a single row needs none.
    row_step = cloud.row_step if height > 1 and cloud.row_step > width * step else width * step
    needed = (height - 1) * row_step + width * step if height else 0
    if len(data) < needed:
        raise ValueError(
            f"a cloud of {width} x {height} points of {step} bytes has {len(data)} bytes of data, "
            f"not {needed}"
        )
    return _numpy().ndarray((height, width), kind, data, strides=(row_step, step))  # type: ignore[no-any-return]


def _all_points(cloud: Any) -> "np.ndarray[Any, Any]":
    """All points in one dimension; a view if there is no padding between rows."""
    return rows_of(cloud, getattr(cloud, "data", b"")).reshape(-1)


Header: Any
PointCloud2: Any
PointField: Any
"""Programs import these from here; they are made at their first use."""


def __getattr__(name: str) -> Any:
    if name not in ("Header", "PointCloud2", "PointField"):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return message_class(f"{'std_msgs' if name == 'Header' else 'sensor_msgs'}/msg/{name}")


def _numpy() -> Any:
    return extra("numpy", "sensor_msgs_py.point_cloud2")
