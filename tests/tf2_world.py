"""Common parts of the tests of transforms: short functions for messages, and buffers on either core."""

from collections.abc import Iterator
from math import cos, sin
from typing import Any

import pytest

from bus_ros.rclpy.time import Time
from bus_tf2.core import twin
from bus_tf2.messages import message
from bus_tf2.tf2_py import BufferCore, buffer_core

__all__ = ["at", "buffer", "either_core", "transform", "yaw"]


def at(seconds: float) -> Time:
    return Time(nanoseconds=round(seconds * 1e9))


def yaw(angle: float) -> tuple[float, float, float, float]:
    """A turn about z, as x, y, z, w."""
    return 0.0, 0.0, sin(angle / 2), cos(angle / 2)


def transform(
    parent: str,
    child: str,
    seconds: float = 0.0,
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turned: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
) -> Any:
    """A TransformStamped."""
    made = message("geometry_msgs/msg/TransformStamped", child_frame_id=child)
    made.header.frame_id, made.header.stamp = parent, at(seconds).to_msg()
    place = made.transform
    place.translation.x, place.translation.y, place.translation.z = map(float, moved)
    place.rotation.x, place.rotation.y, place.rotation.z, place.rotation.w = map(float, turned)
    return made


@pytest.fixture(params=["native", "twin"])
def either_core(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Buffers made during the test are on that core."""
    if request.param == "twin":
        monkeypatch.setattr(buffer_core, "FrameTree", twin.FrameTree)
    else:
        pytest.importorskip("bus_tf2.core._core", reason="BUS_NATIVE=no")
    yield


@pytest.fixture
def buffer(either_core: None) -> BufferCore:
    return BufferCore()
