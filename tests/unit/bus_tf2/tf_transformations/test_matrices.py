"""Matrices of 4 x 4: each checked by its effect."""

import math
import sys
from typing import Any

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_tf2 import tf_transformations as tft
from bus_tf2.tf_transformations import matrices

SEED = np.random.default_rng(7)


def some(count: int = 3) -> Any:
    return SEED.random(count) - 0.5


def test_every_name_is_there() -> None:
    for name in matrices.__all__:
        assert getattr(tft, name) is getattr(matrices, name)
    with pytest.raises(AttributeError, match="module 'tf_transformations' has no attribute 'nothing'"):
        _ = tft.nothing


def test_turns() -> None:
    direction, point = some(), some()
    turn = tft.rotation_matrix(0.7, direction, point)
    assert np.allclose(turn @ [*point, 1], [*point, 1])
    angle, axis, on_axis = tft.rotation_from_matrix(turn)
    assert np.allclose(tft.rotation_matrix(angle, axis, on_axis), turn)
    assert np.allclose(tft.rotation_matrix(math.pi / 2, (0, 0, 1)) @ [1, 0, 0, 1], [0, 1, 0, 1])
    with pytest.raises(ValueError, match="eigenvalue 1"):
        tft.rotation_from_matrix(np.diag([2.0, 2, 2, 1]))


def test_quaternions() -> None:
    for _ in range(20):
        q = tft.random_quaternion()
        assert tft.vector_norm(q) == pytest.approx(1.0)
        again = np.array(tft.quaternion_from_matrix(tft.quaternion_matrix(q)))
        assert np.allclose(again, q) or np.allclose(again, -q)
        assert again[3] >= 0
        assert np.allclose(tft.quaternion_multiply(q, tft.quaternion_inverse(2 * q)), [0, 0, 0, 0.5])
    assert tft.quaternion_from_matrix(tft.rotation_matrix(0.123, (1, 2, 3))) == pytest.approx(
        (0.0164262, 0.0328524, 0.0492786, 0.9981095)
    )
    assert np.allclose(tft.quaternion_conjugate((1, 2, 3, 4)), [-1, -2, -3, 4])
    turn = tft.random_rotation_matrix(some() + 0.5)
    assert np.allclose(turn @ turn.T, np.identity(4))


def test_slerp() -> None:
    start, end = (tft.quaternion_from_euler(0, 0, angle) for angle in (0.0, 1.0))
    half = tft.quaternion_slerp(start, end, 0.5)
    assert tft.euler_from_quaternion(half)[2] == pytest.approx(0.5)
    assert np.allclose(tft.quaternion_slerp(start, end, 0.0), start)
    assert np.allclose(tft.quaternion_slerp(start, end, 1.0), end)
    assert np.allclose(tft.quaternion_slerp(start, start, 0.3), start)
    assert np.allclose(tft.quaternion_slerp(start, [-part for part in end], 0.5), half)


def test_other_kinds() -> None:
    point, normal = some(), some()
    mirror = tft.reflection_matrix(point, normal)
    assert np.allclose(mirror @ [*point, 1], [*point, 1])
    assert np.allclose(mirror @ [*(point + normal), 1], [*(point - normal), 1])
    assert np.allclose(tft.scale_matrix(-1.5) @ [1, 2, 3, 1], [-1.5, -3, -4.5, 1])
    assert np.allclose(tft.scale_matrix(2, point) @ [*(point + 1), 1], [*(point + 2), 1])
    direction = np.cross(normal, some())
    slant = tft.shear_matrix(0.3, direction, point, normal)
    assert np.linalg.det(slant) == pytest.approx(1.0)
    assert np.allclose(slant @ [*(point + direction), 1], [*(point + direction), 1])
    with pytest.raises(ValueError, match="not orthogonal"):
        tft.shear_matrix(0.3, normal, point, normal)
    assert np.allclose(tft.translation_from_matrix(tft.translation_matrix((1, 2, 3))), (1, 2, 3))
    assert np.allclose(tft.identity_matrix(), np.identity(4))


def test_made_of_parts() -> None:
    parts = (some() + 1, some(), (0.1, 0.2, 0.3), some(), [0.1, 0.2, 0.3, 1.0])
    whole = tft.compose_matrix(*parts)
    assert tft.is_same_transform(tft.compose_matrix(*tft.decompose_matrix(whole)), whole)
    scale, shear, angles, move, _ = tft.decompose_matrix(tft.compose_matrix(*parts[:4]))
    assert np.allclose(scale, parts[0])
    assert np.allclose(shear, parts[1])
    assert np.allclose(angles, parts[2])
    assert np.allclose(move, parts[3])
    assert tft.decompose_matrix(tft.scale_matrix(-2))[0] == pytest.approx([-2, -2, -2])
    with pytest.raises(ValueError, match="singular"):
        tft.decompose_matrix(np.zeros((4, 4)))


def test_of_several() -> None:
    a, b = tft.euler_matrix(1, 2, 3), tft.translation_matrix((1, 2, 3))
    assert np.allclose(tft.concatenate_matrices(a, b), a @ b)
    assert np.allclose(tft.inverse_matrix(a), a.T)
    assert tft.euler_from_matrix(tft.euler_matrix(0.1, 0.2, 0.3, "ryxz"), "ryxz") == pytest.approx(
        (0.1, 0.2, 0.3)
    )
    assert tft.is_same_transform(a, 2 * a)
    assert not tft.is_same_transform(a, b)
    points = np.vstack([SEED.random((3, 10)), np.ones(10)])
    moved = tft.concatenate_matrices(b, a, tft.scale_matrix(1.5)) @ points
    assert np.allclose(tft.superimposition_matrix(points, moved, scaling=True) @ points, moved)
    assert np.allclose(tft.superimposition_matrix(points, b @ a @ points), b @ a)
    with pytest.raises(ValueError, match="wrong shape"):
        tft.superimposition_matrix(points, moved[:, 1:])


def test_vectors() -> None:
    values = SEED.random((5, 4, 3))
    lengths = np.empty((5, 3))
    assert tft.vector_norm(values, axis=1, out=lengths) is None
    assert np.allclose(lengths, np.linalg.norm(values, axis=1))
    assert np.allclose(tft.vector_norm(values, axis=-1), np.linalg.norm(values, axis=-1))
    assert tft.vector_norm([]) == 0.0
    assert np.allclose(np.linalg.norm(tft.unit_vector(values, axis=1), axis=1), 1)
    assert tft.unit_vector(values, axis=1, out=values) is None
    assert np.allclose(np.linalg.norm(values, axis=1), 1)
    assert list(tft.unit_vector([])) == []
    assert tft.random_vector(5).shape == (5,)


def test_without_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numpy", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        tft.euler_matrix  # noqa: B018
    assert str(caught.value) == "tf_transformations needs NumPy: pip install 'numpy>=1.26'"
