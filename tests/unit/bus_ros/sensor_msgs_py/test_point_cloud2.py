"""point_cloud2: writing and reading clouds, their layouts, and refusals."""

import sys
from typing import Any

import pytest

from bus.msg import sensor_msgs
from bus_ros.rosidl import message_class
from bus_ros.sensor_msgs_py import numpy_compat
from bus_ros.sensor_msgs_py.point_cloud2 import (
    create_cloud,
    create_cloud_xyz32,
    dtype_from_fields,
    read_points,
    read_points_list,
    read_points_numpy,
)

np = pytest.importorskip("numpy")
PointField: Any = message_class("sensor_msgs/msg/PointField")
Header: Any = message_class("std_msgs/msg/Header")
INT16, UINT8, FLOAT32, FLOAT64 = 3, 2, 7, 8
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}


def fields(*parts: tuple[str, int, int]) -> list[Any]:
    return [PointField(name=name, offset=at, datatype=kind, count=1) for name, at, kind in parts]


MIXED = fields(("x", 0, FLOAT32), ("ring", 4, INT16), ("t", 8, FLOAT64))


def mixed(**options: Any) -> Any:
    return create_cloud(Header(frame_id="lidar"), MIXED, [(1.5, -7, 0.25), (2.5, 8, 0.5)], **options)


def test_xyz() -> None:
    cloud = create_cloud_xyz32(Header(frame_id="lidar"), [(1, 2, 3), [4.0, 5.0, 6.0]])
    assert (cloud.header.frame_id, cloud.width, cloud.height) == ("lidar", 2, 1)
    assert (cloud.point_step, cloud.row_step, len(cloud.data)) == (12, 24, 24)
    assert (cloud.is_dense, cloud.is_bigendian) == (False, sys.byteorder == "big")
    assert [(one.name, one.offset, one.datatype, one.count) for one in cloud.fields] == [
        ("x", 0, 7, 1),
        ("y", 4, 7, 1),
        ("z", 8, 7, 1),
    ]
    points = read_points_numpy(cloud)
    assert points.dtype == np.float32
    assert points.tolist() == [[1, 2, 3], [4, 5, 6]]
    again = create_cloud_xyz32(cloud.header, points)
    assert again.data == cloud.data
    assert create_cloud_xyz32(cloud.header, points.astype(np.float64)).data == cloud.data
    assert create_cloud_xyz32(cloud.header, points[::-1]).data[:12] == cloud.data[12:]


def test_no_points() -> None:
    nothings: Any = ([], np.zeros((0, 3), np.float32))
    for nothing in nothings:
        cloud = create_cloud_xyz32(Header(), nothing)
        assert (cloud.width, cloud.height, len(cloud.data)) == (0, 1, 0)
        assert len(read_points(cloud)) == 0


def test_fields_of_several_kinds() -> None:
    cloud = mixed(point_step=24)
    assert (cloud.point_step, len(cloud.data)) == (24, 48)
    points = read_points(cloud)
    assert points.dtype.names == ("x", "ring", "t")
    assert points["ring"].tolist() == [-7, 8]
    assert read_points(cloud, ("t", "x")).tolist() == [(0.25, 1.5), (0.5, 2.5)]
    found = read_points_list(cloud, ["x", "ring"])
    assert found == [(1.5, -7), (2.5, 8)]
    assert str(found[0]) == "Point(x=1.5, ring=-7)"
    assert read_points_numpy(cloud, ["ring"]).tolist() == [[-7], [8]]
    again = create_cloud(cloud.header, MIXED, points)  # with its own step
    assert (again.point_step, read_points(again).tolist()) == (24, points.tolist())


def test_what_is_read_is_a_view() -> None:
    cloud = mixed()
    read_points(cloud)["x"] = 9
    assert read_points(cloud)["x"].tolist() == [9, 9]


def test_a_cloud_of_the_native_class_is_read_in_place() -> None:
    data: Any = memoryview(np.float32([3, 4]).tobytes())
    field = sensor_msgs.PointField(name="x", datatype=FLOAT32, count=1)
    cloud = sensor_msgs.PointCloud2(height=1, width=2, fields=[field], point_step=4, row_step=8, data=data)
    points = read_points(cloud, skip_nans=False)
    assert points.tolist() == [(3,), (4,)]
    assert not points.flags.writeable


def test_another_byte_order_is_read_into_this_machines() -> None:
    cloud = mixed()
    cloud.is_bigendian = not cloud.is_bigendian
    cloud.data = read_points(mixed()).byteswap().tobytes()
    before = bytes(cloud.data)
    points = read_points(cloud)
    assert points.tolist() == [(1.5, -7, 0.25), (2.5, 8, 0.5)]
    assert points.dtype.isnative
    assert bytes(cloud.data) == before
    assert read_points_numpy(cloud, ["x"]).tolist() == [[1.5], [2.5]]


def test_several_values_in_a_field() -> None:
    of_two = PointField(name="uv", offset=2, datatype=INT16, count=2)
    nameless = PointField(offset=0, datatype=UINT8, count=1)
    kind: Any = dtype_from_fields([nameless, of_two], point_step=8)
    assert kind.names == ("unnamed_field_0", "uv_0", "uv_1")
    assert [kind.fields[name][1] for name in kind.names] == [0, 2, 4]
    assert kind.itemsize == 8
    cloud = create_cloud(Header(), [nameless, of_two], [(1, 2, 3)])
    assert [one._asdict() for one in read_points_list(cloud)] == [
        {"unnamed_field_0": 1, "uv_0": 2, "uv_1": 3}
    ]


def test_nan_and_uvs() -> None:
    nan = float("nan")
    cloud = create_cloud_xyz32(Header(), [(0, 0, nan), (1, 1, 1), (nan, 2, 2), (3, 3, 3)])
    assert read_points(cloud, skip_nans=True)["y"].tolist() == [1, 3]
    assert read_points(cloud, ["x", "y"], skip_nans=True)["y"].tolist() == [0, 1, 3]
    assert read_points(cloud, uvs=[3, 0])["y"].tolist() == [3, 0]
    assert read_points(cloud, uvs=np.array([1]))["y"].tolist() == [1]
    cloud.is_dense = True
    assert len(read_points(cloud, skip_nans=True)) == 4


def test_an_organized_cloud() -> None:
    points = np.arange(3 * 2 * 3, dtype=np.float32).reshape(3, 2, 3)
    cloud = create_cloud_xyz32(Header(), points)
    assert (cloud.width, cloud.height, cloud.row_step) == (3, 2, 36)
    assert read_points(cloud, reshape_organized_cloud=True).shape == (3, 2)
    assert (read_points_numpy(cloud, reshape_organized_cloud=True) == points).all()
    assert read_points(cloud).shape == (6,)
    with pytest.raises(ValueError, match="1 of 3 x 2 points can't be organized"):
        read_points(cloud, uvs=[0], reshape_organized_cloud=True)


def test_rows_with_padding() -> None:
    cloud = create_cloud_xyz32(Header(), np.arange(4 * 3, dtype=np.float32).reshape(4, 3))
    rows = bytes(cloud.data)
    cloud.width = cloud.height = 2
    cloud.row_step, cloud.data = 29, rows[:24] + b"-----" + rows[24:]
    assert read_points_numpy(cloud).ravel().tolist() == list(range(12))


def test_what_is_refused() -> None:
    cloud = mixed()
    with pytest.raises(AssertionError, match=r"Cloud is not a sensor_msgs\.msg\.PointCloud2"):
        read_points(Header())
    with pytest.raises(AssertionError, match="Requests field is not in the fields of the PointCloud!"):
        read_points(cloud, ["y"])
    with pytest.raises(AssertionError, match=r"same datatype\. Use `read_points\(\)` otherwise"):
        read_points_numpy(cloud)
    with pytest.raises(AssertionError, match="Can't process fields with count = 0"):
        dtype_from_fields([PointField(name="x", datatype=1)])
    with pytest.raises(AssertionError, match="Duplicate field names are not allowed!"):
        dtype_from_fields(fields(("x", 0, 1), ("x", 1, 1)))
    with pytest.raises(ValueError, match="field 'x' has the datatype 9: there are 1 to 8"):
        dtype_from_fields(fields(("x", 0, 9)))
    with pytest.raises(ValueError, match="field 'x' ends at byte 8: a point has 7 bytes"):
        dtype_from_fields(fields(("x", 4, 7)), 7)
    with pytest.raises(ValueError, match="field 'x' has a count of 4294967295: a point has 65536 at most"):
        dtype_from_fields([PointField(name="x", datatype=1, count=2**32 - 1)])
    cloud.width = 3
    with pytest.raises(ValueError, match="3 x 1 points of 16 bytes has 32 bytes of data, not 48"):
        read_points(cloud)
    with pytest.raises(AssertionError, match="Pass a structured NumPy array"):
        create_cloud(Header(), MIXED, np.zeros((2, 3)))
    with pytest.raises(AssertionError, match="do not match for all fields"):
        create_cloud(Header(), MIXED, np.zeros(2, np.dtype([("x", "f4")])))
    with pytest.raises(AssertionError, match="Too many dimensions"):
        create_cloud_xyz32(Header(), np.zeros((2, 2, 2, 3), np.float32))


def test_without_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = mixed()
    monkeypatch.setitem(sys.modules, "numpy", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        read_points(cloud)
    assert str(caught.value) == "sensor_msgs_py.point_cloud2 needs NumPy: pip install 'numpy>=1.26'"


def test_columns_with_names_and_without() -> None:
    plain = np.array([[1, 2], [3, 4]], np.int16)
    named = numpy_compat.unstructured_to_structured(plain, names=["a", "b"])
    assert named["b"].tolist() == [2, 4]
    assert (numpy_compat.structured_to_unstructured(named) == plain).all()
