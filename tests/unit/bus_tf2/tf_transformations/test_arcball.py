"""tf_transformations.arcball: a ball that a pointer turns."""

import math

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_tf2.tf_transformations import (
    Arcball,
    arcball_constrain_to_axis,
    arcball_map_to_sphere,
    arcball_nearest_axis,
    euler_matrix,
    identity_matrix,
    quaternion_from_euler,
    rotation_from_matrix,
)


def test_a_point_on_the_ball() -> None:
    assert np.allclose(arcball_map_to_sphere((320, 240), (320, 240), 320), (0, 0, 1))
    assert np.allclose(arcball_map_to_sphere((320, 80), (320, 240), 320), (0, 0.5, math.sqrt(0.75)))
    assert np.allclose(arcball_map_to_sphere((1000, 240), (320, 240), 320), (1, 0, 0))


def test_axes() -> None:
    point = arcball_constrain_to_axis((0.6, 0.0, -0.8), (1, 0, 0))
    assert np.allclose(point, (0, 0, 1))
    assert np.allclose(arcball_constrain_to_axis((0, 0, 1), (0, 0, 1)), (1, 0, 0))
    assert np.allclose(arcball_constrain_to_axis((1, 0, 0), (1, 0, 0)), (0, 1, 0))
    axes = ((1, 0, 0), (0, 1, 0))
    assert arcball_nearest_axis((0.6, 0.1, 0.8), axes) == (0, 1, 0)


def test_it_turns_with_the_pointer() -> None:
    ball = Arcball()
    assert np.allclose(ball.matrix(), identity_matrix())
    ball.place((320, 320), 320)
    ball.down((320, 320))
    ball.drag((480, 320))  # 30 degrees to the right, which turns the ball by twice as many
    angle, axis, _ = rotation_from_matrix(ball.matrix())
    assert angle * axis[1] == pytest.approx(math.radians(60))
    before = ball.matrix()
    ball.next()
    assert np.allclose(ball.matrix(), before @ before)
    ball.down((100, 100))
    ball.drag((100, 100))
    assert np.allclose(ball.matrix(), before @ before)


def test_it_turns_about_the_nearest_axis() -> None:
    ball = Arcball(initial=quaternion_from_euler(0, 0, 0))
    ball.setaxes((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert not ball.getconstrain()
    ball.setconstrain(True)
    assert ball.getconstrain()
    ball.down((0, 0))
    ball.drag((0.1, 0.5))
    _, axis, _ = rotation_from_matrix(ball.matrix())
    assert sorted(abs(axis)) == pytest.approx([0, 0, 1])


def test_what_it_begins_with() -> None:
    assert np.allclose(Arcball(euler_matrix(0.1, 0.2, 0.3)).matrix(), euler_matrix(0.1, 0.2, 0.3))
    with pytest.raises(ValueError, match=r"^initial not a quaternion or matrix$"):
        Arcball((1, 2, 3))
