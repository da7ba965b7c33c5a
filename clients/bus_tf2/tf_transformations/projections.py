"""Homogeneous matrices that flatten space or a part of it, and the parts that a matrix was made of."""

import math
from typing import Any

import numpy as np

from bus_tf2.tf_transformations.matrices import Array, Numbers, unit_vector

__all__ = [
    "clip_matrix",
    "orthogonalization_matrix",
    "projection_from_matrix",
    "projection_matrix",
    "reflection_from_matrix",
    "scale_from_matrix",
    "shear_from_matrix",
]

_EPS = 1e-8


# --- made


def projection_matrix(
    point: Numbers,
    normal: Numbers,
    direction: Numbers | None = None,
    perspective: Numbers | None = None,
    pseudo: bool = False,
) -> Array:
    """The projection onto the plane through `point` that is perpendicular to `normal`.

    Along the normal, along `direction`, or towards the point `perspective`. With `pseudo`, a projection with
    `perspective` keeps depths, so points that lie behind stay known.
    """
    place, up = np.array(point[:3], float), np.asarray(unit_vector(normal[:3]))
    made = np.identity(4)
    if perspective is not None:
        eye = np.array(perspective[:3], float)
        made[:3, :3] *= (eye - place) @ up
        made[:3, :3] -= np.outer(eye, up)
        made[:3, 3] = (place @ up) * eye
        if pseudo:
            made[:3, :3] -= np.outer(up, up)
            made[:3, 3] += (place @ up) * up
        made[3] = (*-up, eye @ up)
        return made
    along = up if direction is None else np.array(direction[:3], float)
    flat = np.outer(along, up) / (along @ up)
    made[:3, :3] -= flat
    made[:3, 3] = flat @ place
    return made


def clip_matrix(
    left: float, right: float, bottom: float, top: float, near: float, far: float, perspective: bool = False
) -> Array:
    """The matrix that maps a box, or with `perspective` a truncated pyramid, to the cube from -1 to 1.

    The eye is at the origin and looks along z. With `perspective`, the fourth number divides the others.
    Raises ValueError if a side is not before the other.
    """
    if left >= right or bottom >= top or near >= far:
        raise ValueError("invalid frustrum")
    low, high = np.array((left, bottom, near), float), np.array((right, top, far), float)
    size, middle = high - low, high + low
    made = np.identity(4)
    if not perspective:
        made[:3, :3] = np.diag(2.0 / size)
        made[:3, 3] = -middle / size
        return made
    if near <= _EPS:
        raise ValueError("invalid frustrum: near <= 0")
    made[[0, 1], [0, 1]] = -2.0 * near / size[:2]
    made[:2, 2] = middle[:2] / size[:2]
    made[2, 2:] = -middle[2] / size[2], 2.0 * near * far / size[2]
    made[3] = 0.0, 0.0, -1.0, 0.0
    return made


def orthogonalization_matrix(lengths: Numbers, angles: Numbers) -> Array:
    """From the coordinates of a crystal's cell, with edges of these lengths and angles (in degrees)."""
    a, b, c = lengths
    alpha, beta, gamma = np.radians(angles)
    part = (math.cos(alpha) * math.cos(beta) - math.cos(gamma)) / (math.sin(alpha) * math.sin(beta))
    made = np.identity(4)
    made[:3, 0] = a * np.array(
        (math.sin(beta) * math.sqrt(1 - part * part), -math.sin(beta) * part, math.cos(beta))
    )
    made[1:3, 1] = b * math.sin(alpha), b * math.cos(alpha)
    made[2, 2] = c
    return made


# --- taken apart


def reflection_from_matrix(matrix: Any) -> tuple[Array, Array]:
    """The point, with a fourth number 1, and the normal of a mirror. Raises ValueError if it is none."""
    whole = np.array(matrix, float)
    return _fixed_point(whole), _vector(whole[:3, :3], -1.0)


def scale_from_matrix(matrix: Any) -> tuple[float, Array, Array | None]:
    """The factor, the origin, with a fourth number 1, and the direction of a scaling; None: in all.

    Raises ValueError if it is no scaling.
    """
    whole = np.array(matrix, float)
    linear = whole[:3, :3]
    factor = float(np.trace(linear)) - 2.0
    try:
        direction: Array | None = _vector(linear, factor)
    except ValueError:
        factor, direction = (factor + 2.0) / 3.0, None
    return factor, _fixed_point(whole), direction


def shear_from_matrix(matrix: Any) -> tuple[float, Array, Array, Array]:
    """The angle, the direction, a point, with a fourth number 1, and the normal of a shear.

    Raises ValueError if it is none.
    """
    whole = np.array(matrix, float)
    left, sizes, right = np.linalg.svd(whole[:3, :3] - np.identity(3))
    direction, normal, slope = left[:, 0], right[0], float(sizes[0])
    if slope < _EPS or sizes[1] > _EPS or abs(direction @ normal) > _EPS:
        raise ValueError("the matrix is no shear")
    away = -(whole[:3, 3] @ direction) / slope
    return math.atan(slope), direction, np.array((*(away * normal), 1.0)), normal


def projection_from_matrix(
    matrix: Any, pseudo: bool = False
) -> tuple[Array, Array, Array | None, Array | None, bool]:
    """Point, normal, direction, perspective and `pseudo` of a projection, as `projection_matrix` takes them.

    Points have a fourth number, 1. Raises ValueError if it is no projection.
    """
    whole = np.array(matrix, float)
    linear = whole[:3, :3]
    values, vectors = np.linalg.eig(whole)
    fixed = np.where(abs(values.real - 1.0) < _EPS)[0]
    if not pseudo and len(fixed):
        point = vectors[:, fixed[-1]].real
        direction = _vector(linear, 0.0)
        normal = _vector(linear.T, 0.0)
        return point / point[3], normal, direction, None, False
    seen = np.where(abs(values.real) > _EPS)[0]
    if not len(seen) or not np.linalg.norm(whole[3, :3]) > _EPS:
        raise ValueError("no eigenvector not corresponding to eigenvalue 0")
    point = vectors[:, seen[-1]].real
    point = point / point[3]
    normal = -whole[3, :3]
    perspective = whole[:3, 3] / (point[:3] @ normal)
    if pseudo:
        perspective = perspective - normal
    return point, normal, None, perspective, pseudo


def _vector(linear: Array, value: float) -> Array:
    """The direction that a matrix makes `value` times as long."""
    values, vectors = np.linalg.eig(linear)
    found = np.where(abs(values.real - value) < _EPS)[0]
    if not len(found):
        raise ValueError(f"no unit eigenvector corresponding to eigenvalue {value:g}")
    return np.asarray(unit_vector(vectors[:, found[0]].real))


def _fixed_point(whole: Array) -> Array:
    """A point that does not move."""
    values, vectors = np.linalg.eig(whole)
    for index in np.where(abs(values.real - 1.0) < _EPS)[0][::-1]:
        point = vectors[:, index].real
        if abs(point[3]) > _EPS:
            return np.asarray(point / point[3])
    raise ValueError("no eigenvector corresponding to eigenvalue 1")
