"""Euler angles for every sequence of axes, and quaternions."""

import math
from itertools import product

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_tf2 import tf_transformations as tft
from bus_tf2.tf_transformations.angles import angles_of, euler_from_quaternion, quaternion_from_euler, turn_of
from rows import for_each

SEQUENCES = [
    frame + "".join(axes)
    for frame in "sr"
    for axes in product("xyz", repeat=3)
    if axes[0] != axes[1] != axes[2]
]


def elementary(axis: str, angle: float) -> np.ndarray:  # type: ignore[type-arg]
    """A turn about one axis, as in a textbook."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    made = np.identity(3)
    made[j, j] = made[k, k] = math.cos(angle)
    made[k, j], made[j, k] = math.sin(angle), -math.sin(angle)
    return made


@for_each("axes", SEQUENCES)
def test_every_sequence(axes: str) -> None:
    for angles in (
        (0.3, 0.9, -2.0),
        (-3.0, 1.2, 3.0),
        (1.0, 0.0, 0.5),
        (0.0, math.pi / 2, 0.4),
        (0.2, math.pi, 0),
    ):
        turn = np.identity(3)
        for axis, angle in zip(axes[1:], angles, strict=True):
            step = elementary(axis, angle)
            turn = turn @ step if axes[0] == "r" else step @ turn
        quaternion = quaternion_from_euler(*angles, axes=axes)
        assert np.allclose(turn_of(quaternion), turn)
        again = quaternion_from_euler(*euler_from_quaternion(quaternion, axes), axes=axes)
        assert np.allclose(turn_of(again), turn)
    # Of the two answers, this API always gives the one with this middle angle.
    second = -0.9 if axes[1:] in ("xzx", "yxy", "zyz") else 0.9
    angles = (0.3, second, -2.0)
    assert angles_of(turn_of(quaternion_from_euler(*angles, axes=axes)), axes) == pytest.approx(angles)


def test_as_transforms3d() -> None:
    """ROS 2's module is built on this library."""
    euler = pytest.importorskip("transforms3d.euler", reason="pip install transforms3d")
    for axes, angles in product(SEQUENCES, ((0.3, 0.9, -2.0), (-6.0, 4.2, 3.0), (1.0, -0.4, 0.5))):
        w, x, y, z = euler.euler2quat(*angles, axes=axes)
        assert quaternion_from_euler(*angles, axes=axes) == pytest.approx((x, y, z, w))
        turn = euler.euler2mat(*angles, axes=axes)
        assert angles_of(turn, axes) == pytest.approx(euler.mat2euler(turn, axes=axes))


def test_known_values() -> None:
    assert tft.quaternion_from_euler(1, 2, 3, "ryxz") == pytest.approx(
        (0.310622, -0.718287, 0.444435, 0.435953), abs=1e-6
    )
    assert tft.quaternion_from_euler(0, 0, math.pi) == pytest.approx((0, 0, 1, 0))
    assert tft.euler_from_quaternion([0.06146124, 0, 0, 0.99810947]) == pytest.approx((0.123, 0, 0))
    assert tft.quaternion_about_axis(0.123, (2, 0, 0)) == pytest.approx((0.06146124, 0, 0, 0.99810947))
    assert tft.quaternion_multiply([1, -2, 3, 4], [-5, 6, 7, 8]) == (-44, -14, 48, 28)
    assert tft.euler_from_quaternion((0, 0, 0, 0)) == (0.0, 0.0, 0.0)


def test_the_older_form_of_axes() -> None:
    for code, axes in (
        ((0, 0, 0, 0), "sxyz"),
        ((2, 1, 0, 1), "rxyz"),
        ((1, 1, 0, 0), "syxz"),
        ((0, 0, 1, 1), "rxyx"),
    ):
        assert tft.quaternion_from_euler(1, 2, 3, code) == tft.quaternion_from_euler(1, 2, 3, axes)


@for_each("axes", ["", "xyz", "sxy", "sxxy", "sabc", "txyz"])
def test_no_sequence(axes: str) -> None:
    with pytest.raises(ValueError, match="is no sequence of axes: 's' or 'r' and three of x, y, z"):
        tft.quaternion_from_euler(0, 0, 0, axes)
