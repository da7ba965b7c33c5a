"""Point clouds in the coordinates of another frame."""

import math
from typing import Any

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_tf2.messages import message
from bus_tf2.tf2_ros import Buffer
from bus_tf2.tf2_sensor_msgs import do_transform_cloud, transform_points
from rows import for_each
from tf2_world import transform, yaw

MOVE = transform("world", "robot", 3, (10, 20, 30), yaw(math.pi / 2))


def cloud(order: str, height: int, padding: int) -> tuple[Any, np.ndarray[Any, Any]]:
    """A cloud of points with y, z, x, and one field that stays. Its rows end with padding."""
    kind = np.dtype([("y", order + "f4"), ("z", order + "f8"), ("ring", order + "u2"), ("x", order + "f4")])
    points = np.zeros((height, 3), kind)
    points["x"], points["y"], points["z"], points["ring"] = 1, 2, 3, np.arange(3)
    rows = [row.tobytes() + b"\x07" * padding for row in points]
    types = {"f4": 7, "f8": 8, "u2": 4}
    made = message(
        "sensor_msgs/msg/PointCloud2",
        height=height,
        width=3,
        point_step=kind.itemsize,
        row_step=3 * kind.itemsize + padding,
        is_bigendian=order == ">",
        data=b"".join(rows),
        fields=[
            message(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=offset,
                datatype=types[format_.str[1:]],
                count=1,
            )
            for name, (format_, offset) in (kind.fields or {}).items()
        ],
    )
    made.header.frame_id, made.header.stamp.sec = "robot", 5
    return made, points


@for_each(("order", "height", "padding"), [("<", 1, 0), (">", 2, 0), ("<", 2, 5)])
def test_a_cloud(order: str, height: int, padding: int) -> None:
    before, points = cloud(order, height, padding)
    buffer = Buffer()
    buffer.set_transform_static(MOVE, "me")
    after = buffer.transform(before, "world")
    points["x"], points["y"], points["z"] = 8, 21, 33
    rows = [row.tobytes() + b"\x07" * padding for row in points]
    assert bytes(after.data) == b"".join(rows)
    assert (after.header.frame_id, after.header.stamp.sec) == ("world", 5)
    assert after.fields == before.fields


def test_one_that_does_not_say_how_long_its_rows_are() -> None:
    before, _ = cloud("<", 2, 0)
    whole = do_transform_cloud(before, MOVE)
    before.row_step = 0
    assert do_transform_cloud(before, MOVE).data == whole.data


def test_an_empty_one() -> None:
    before, _ = cloud("<", 1, 0)
    before.width, before.data, before.row_step = 0, b"", 0
    assert len(do_transform_cloud(before, MOVE).data) == 0


def test_what_is_no_cloud() -> None:
    before, _ = cloud("<", 2, 0)
    before.data = before.data[:-1]
    with pytest.raises(ValueError, match="has 107 bytes of data, not 108"):
        do_transform_cloud(before, MOVE)
    before, _ = cloud("<", 2, 0)
    before.fields = before.fields[1:]
    with pytest.raises(ValueError, match="has no field 'y'"):
        do_transform_cloud(before, MOVE)


def test_points() -> None:
    assert np.allclose(transform_points([[1, 2, 3]], MOVE.transform), [[8, 21, 33]])
