"""LaserProjection: the points of a scan, their places, and their fields."""

from typing import Any

import pytest

from bus_ros.laser_geometry import LaserProjection
from bus_ros.rosidl import message_class
from bus_ros.sensor_msgs_py.point_cloud2 import read_points

np = pytest.importorskip("numpy")
LaserScan: Any = message_class("sensor_msgs/msg/LaserScan")
OPTION = LaserProjection.ChannelOption


def scan(**fields: Any) -> Any:
    options = {
        "angle_min": -np.pi / 2,
        "angle_increment": np.pi / 2,
        "time_increment": 0.5,
        "range_min": 0.5,
        "range_max": 10.0,
        "ranges": [1.0, 2.0, 3.0, 0.1, 10.0, float("nan"), float("inf")],
        **fields,
    }
    message = LaserScan(**options)
    message.header.frame_id = "laser"
    return message


def points(cloud: Any) -> Any:
    return np.round(np.array(read_points(cloud).tolist()), 5).tolist()


def test_points_in_range() -> None:
    cloud = LaserProjection().projectLaser(scan())
    assert cloud.header.frame_id == "laser"
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "index"]
    assert points(cloud) == [[0, -1, 0, 0], [2, 0, 0, 1], [0, 3, 0, 2]]


def test_all_channels() -> None:
    every = OPTION.DEFAULT | OPTION.DISTANCE | OPTION.TIMESTAMP | OPTION.VIEWPOINT
    cloud = LaserProjection().projectLaser(scan(intensities=[7.0] * 7), 2.5, every)
    assert [field.name for field in cloud.fields][3:] == [
        *("intensity", "index", "distances", "stamps"),
        *("vp_x", "vp_y", "vp_z"),
    ]
    assert points(cloud) == [[0, -1, 0, 7, 0, 1, 0, 0, 0, 0], [2, 0, 0, 7, 1, 2, 0.5, 0, 0, 0]]


def test_no_points_and_no_channels() -> None:
    cloud = LaserProjection().projectLaser(scan(ranges=[]), channel_options=OPTION.NONE)
    assert (cloud.width, len(cloud.fields), cloud.point_step) == (0, 3, 12)


def test_too_few_intensities() -> None:
    with pytest.raises(ValueError, match="a scan with 7 ranges has 2 intensities"):
        LaserProjection().projectLaser(scan(intensities=[1.0, 2.0]))
