"""tf_transformations.projections: their effect on points, and their parts."""

import math
from typing import Any

import pytest

pytest.importorskip("numpy")

import numpy as np

from bus_tf2.tf_transformations import (
    clip_matrix,
    identity_matrix,
    is_same_transform,
    orthogonalization_matrix,
    projection_from_matrix,
    projection_matrix,
    random_rotation_matrix,
    reflection_from_matrix,
    reflection_matrix,
    scale_from_matrix,
    scale_matrix,
    shear_from_matrix,
    shear_matrix,
)

RANDOM = np.random.default_rng(5)
TRIALS = 20


def vector() -> Any:
    return RANDOM.uniform(-1, 1, 3)


def moved(matrix: Any, point: Any) -> Any:
    found = matrix @ (*point[:3], 1.0)
    return found[:3] / found[3]


def test_projections_lie_in_the_plane_and_stay_there() -> None:
    for _ in range(TRIALS):
        point, normal, along, eye, some = vector(), vector(), vector(), 3 * vector(), vector()
        normal /= np.linalg.norm(normal)
        for kind, way in (
            ({}, normal),
            ({"direction": along}, along),
            ({"perspective": eye}, some - eye),
        ):
            matrix = projection_matrix(point, normal, **kind)
            found = moved(matrix, some)
            assert (found - point) @ normal == pytest.approx(0, abs=1e-6)
            assert np.allclose(moved(matrix, found), found, atol=1e-6)
            assert np.allclose(np.cross(found - some, way), 0, atol=1e-6)


def test_a_pseudo_projection_keeps_depths_apart() -> None:
    matrix = projection_matrix((0, 0, 0), (0, 0, 1), perspective=(0, 0, -2), pseudo=True)
    near, far = moved(matrix, (1, 1, 1)), moved(matrix, (1, 1, 2))
    plain = projection_matrix((0, 0, 0), (0, 0, 1), perspective=(0, 0, -2))
    assert np.allclose(near[:2], moved(plain, (1, 1, 1))[:2])
    assert near[2] != far[2]


def test_what_a_projection_is_made_of() -> None:
    for _ in range(TRIALS):
        point, normal, along, eye = vector(), vector(), vector(), 3 * vector()
        for kind in (
            {},
            {"direction": along},
            {"perspective": eye},
            {"perspective": eye, "pseudo": True},
        ):
            matrix = projection_matrix(point, normal, **kind)
            parts = projection_from_matrix(matrix, pseudo=bool(kind.get("pseudo")))
            assert is_same_transform(matrix, projection_matrix(*parts))
    with pytest.raises(ValueError, match="eigenvalue 0"):
        projection_from_matrix(np.diag([2.0, 3.0, 4.0, 5.0]))


def test_a_box_becomes_a_cube() -> None:
    box = (-1.0, 2.0, 3.0, 5.0, 0.5, 4.0)
    matrix = clip_matrix(*box)
    assert np.allclose(moved(matrix, box[::2]), -1)
    assert np.allclose(moved(matrix, box[1::2]), 1)
    seen = clip_matrix(*box, perspective=True)
    assert np.allclose(moved(seen, box[::2]), -1)
    assert np.allclose(moved(seen, (box[1], box[3], box[4])), (1, 1, -1))
    wider = box[5] / box[4]
    assert np.allclose(moved(seen, (box[1] * wider, box[3] * wider, box[5])), 1)
    with pytest.raises(ValueError, match=r"^invalid frustrum$"):
        clip_matrix(2, 1, 0, 1, 0, 1)
    with pytest.raises(ValueError, match="near <= 0"):
        clip_matrix(0, 1, 0, 1, 0, 1, perspective=True)


def test_the_cell_of_a_crystal() -> None:
    assert np.allclose(orthogonalization_matrix((10, 10, 10), (90, 90, 90))[:3, :3], 10 * np.identity(3))
    lengths, angles = (9.8, 12.0, 15.5), (87.2, 80.7, 69.7)
    a, b, c = orthogonalization_matrix(lengths, angles)[:3, :3].T
    assert [np.linalg.norm(edge) for edge in (a, b, c)] == pytest.approx(lengths)
    between = [(b, c), (a, c), (a, b)]
    cosines = [u @ v / np.linalg.norm(u) / np.linalg.norm(v) for u, v in between]
    assert [math.degrees(math.acos(one)) for one in cosines] == pytest.approx(angles)


def test_mirrors() -> None:
    for _ in range(TRIALS):
        matrix = reflection_matrix(vector(), vector())
        assert is_same_transform(matrix, reflection_matrix(*reflection_from_matrix(matrix)))
    with pytest.raises(ValueError, match="eigenvalue -1"):
        reflection_from_matrix(identity_matrix())


def test_sizes() -> None:
    for _ in range(TRIALS):
        factor = float(RANDOM.uniform(1.5, 5))
        for matrix in (scale_matrix(factor, vector()), scale_matrix(factor, vector(), vector())):
            parts = scale_from_matrix(matrix)
            assert parts[0] == pytest.approx(factor)
            assert is_same_transform(matrix, scale_matrix(*parts))


def test_shears() -> None:
    for _ in range(TRIALS):
        direction = vector()
        matrix = shear_matrix(
            float(RANDOM.uniform(0.1, 1.4)), direction, vector(), np.cross(direction, vector())
        )
        assert is_same_transform(matrix, shear_matrix(*shear_from_matrix(matrix)))
    for other in (identity_matrix(), random_rotation_matrix()):
        with pytest.raises(ValueError, match="no shear"):
            shear_from_matrix(other)
