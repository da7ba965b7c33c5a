"""Homogeneous matrices of 4 x 4, and the functions of quaternions that need NumPy."""

import math
from typing import Any

import numpy as np

from bus_tf2.tf_transformations.angles import (
    Axes,
    angles_of,
    quaternion_about_axis,
    quaternion_from_euler,
    turn_of,
)

__all__ = [
    "compose_matrix",
    "concatenate_matrices",
    "decompose_matrix",
    "euler_from_matrix",
    "euler_matrix",
    "identity_matrix",
    "inverse_matrix",
    "is_same_transform",
    "quaternion_conjugate",
    "quaternion_from_matrix",
    "quaternion_inverse",
    "quaternion_matrix",
    "quaternion_slerp",
    "random_quaternion",
    "random_rotation_matrix",
    "random_vector",
    "reflection_matrix",
    "rotation_from_matrix",
    "rotation_matrix",
    "scale_matrix",
    "shear_matrix",
    "superimposition_matrix",
    "translation_from_matrix",
    "translation_matrix",
    "unit_vector",
    "vector_norm",
]

Array = np.ndarray[Any, np.dtype[np.float64]]
Numbers = Any
"""A sequence, or an array."""


# --- of one kind


def identity_matrix() -> Array:
    return np.identity(4)


def translation_matrix(direction: Numbers) -> Array:
    made = np.identity(4)
    made[:3, 3] = direction[:3]
    return made


def translation_from_matrix(matrix: Any) -> Array:
    return np.array(matrix, float)[:3, 3]


def rotation_matrix(angle: float, direction: Numbers, point: Numbers | None = None) -> Array:
    """A turn about an axis through the origin, or through `point`."""
    made = quaternion_matrix(quaternion_about_axis(angle, direction[:3]))
    return made if point is None else _around(made, point)


def rotation_from_matrix(matrix: Any) -> tuple[float, Array, Array]:
    """The angle, the axis, and a point on the axis (with a fourth number, 1) of a turn.

    Raises ValueError if the matrix is no turn.
    """
    whole = np.array(matrix, float)
    turn = whole[:3, :3]
    values, vectors = np.linalg.eig(turn.T)
    fixed = np.where(abs(values.real - 1.0) < 1e-8)[0]
    if not len(fixed):
        raise ValueError("no unit eigenvector corresponding to eigenvalue 1")
    axis = vectors[:, fixed[-1]].real
    values, vectors = np.linalg.eig(whole)
    fixed = np.where(abs(values.real - 1.0) < 1e-8)[0]
    if not len(fixed):
        raise ValueError("no unit eigenvector corresponding to eigenvalue 1")
    point = vectors[:, fixed[-1]].real
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = math.atan2(float(skew @ axis) / 2, (float(np.trace(turn)) - 1.0) / 2)
    return angle, axis, point / point[3]


def scale_matrix(factor: float, origin: Numbers | None = None, direction: Numbers | None = None) -> Array:
    """Make larger in all directions or in one, around the origin or `origin`."""
    made = np.identity(4)
    if direction is None:
        made[:3, :3] *= factor
    else:
        along = unit_vector(direction[:3])
        made[:3, :3] -= (1.0 - factor) * np.outer(along, along)
    return made if origin is None else _around(made, origin)


def reflection_matrix(point: Numbers, normal: Numbers) -> Array:
    """A mirror: the plane through `point` that `normal` stands on."""
    return scale_matrix(-1.0, point, normal)


def shear_matrix(angle: float, direction: Numbers, point: Numbers, normal: Numbers) -> Array:
    """Slant along `direction`, which lies in the plane through `point` that `normal` stands on.

    Raises ValueError if it does not.
    """
    along, up = unit_vector(direction[:3]), unit_vector(normal[:3])
    if abs(float(along @ up)) > 1e-6:
        raise ValueError("direction and normal vectors are not orthogonal")
    made = np.identity(4)
    made[:3, :3] += math.tan(angle) * np.outer(along, up)
    return _around(made, point)


def _around(matrix: Array, point: Numbers) -> Array:
    """The same around a point instead of the origin."""
    made = matrix.copy()
    place = np.array(point[:3], float)
    made[:3, 3] = place - matrix[:3, :3] @ place
    return made


# --- of several


def concatenate_matrices(*matrices: Any) -> Array:
    """Their product; the last is done first."""
    made = np.identity(4)
    for one in matrices:
        made = made @ np.asarray(one, float)
    return made


def inverse_matrix(matrix: Any) -> Array:
    return np.asarray(np.linalg.inv(np.asarray(matrix, float)))


def is_same_transform(matrix0: Any, matrix1: Any) -> bool:
    """Whether they do the same, up to a factor of all numbers."""
    a, b = (np.array(one, float) for one in (matrix0, matrix1))
    return bool(np.allclose(a / a[3, 3], b / b[3, 3]))


def compose_matrix(
    scale: Numbers | None = None,
    shear: Numbers | None = None,
    angles: Numbers | None = None,
    translate: Numbers | None = None,
    perspective: Numbers | None = None,
) -> Array:
    """The matrix of sizes along the axes, slants (xy, xz, yz), roll, pitch and yaw, a move, a last row."""
    made = np.identity(4)
    if perspective is not None:
        made[3, :] = perspective[:4]
    if translate is not None:
        made = made @ translation_matrix(translate)
    if angles is not None:
        made = made @ euler_matrix(angles[0], angles[1], angles[2])
    if shear is not None:
        slant = np.identity(4)
        slant[0, 1], slant[0, 2], slant[1, 2] = shear
        made = made @ slant
    if scale is not None:
        made = made @ np.diag([*scale[:3], 1.0])
    return np.asarray(made / made[3, 3])


def decompose_matrix(matrix: Any) -> tuple[Array, list[float], tuple[float, float, float], Array, Array]:
    """The arguments of `compose_matrix` for the matrix: sizes, slants, angles, a move, a last row.

    Raises ValueError if the matrix is singular.
    """
    whole = np.array(matrix, float)
    if abs(whole[3, 3]) < 1e-15 or abs(np.linalg.det(whole[:3, :3])) < 1e-300:
        raise ValueError("matrix is singular")
    whole /= whole[3, 3]
    perspective = np.array([0.0, 0.0, 0.0, 1.0])
    if np.any(abs(whole[3, :3]) > 1e-15):
        affine = whole.copy()
        affine[3] = perspective
        perspective = whole[3] @ np.linalg.inv(affine)
        whole = affine
    turn, upper = np.linalg.qr(whole[:3, :3])
    signs = np.where(np.diag(upper) < 0, -1.0, 1.0)
    turn, upper = turn * signs, upper * signs[:, None]
    if np.linalg.det(turn) < 0:
        turn, upper = -turn, -upper
    scale = np.diag(upper).copy()
    slants = [upper[0, 1] / scale[1], upper[0, 2] / scale[2], upper[1, 2] / scale[2]]
    return scale, slants, angles_of(turn), whole[:3, 3].copy(), perspective


def superimposition_matrix(v0: Any, v1: Any, scaling: bool = False, usesvd: bool = True) -> Array:
    """The turn and move, with `scaling` a size too, that bring points `v0` nearest to `v1`: 3 x n or 4 x n.

    `usesvd` makes no difference.
    """
    here, there = (np.array(one, float)[:3] for one in (v0, v1))
    if here.shape != there.shape or here.shape[1] < 3:
        raise ValueError("vector sets are of wrong shape or type")
    from_here, from_there = (one - one.mean(axis=1, keepdims=True) for one in (here, there))
    left, _, right = np.linalg.svd(from_there @ from_here.T)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    made = np.identity(4)
    made[:3, :3] = left @ flip @ right
    if scaling:
        made[:3, :3] *= math.sqrt((from_there**2).sum() / (from_here**2).sum())
    made[:3, 3] = there.mean(axis=1) - made[:3, :3] @ here.mean(axis=1)
    return made


# --- angles and quaternions


def euler_matrix(ai: float, aj: float, ak: float, axes: Axes = "sxyz") -> Array:
    """The turn by three angles about `axes`."""
    return quaternion_matrix(quaternion_from_euler(ai, aj, ak, axes))


def euler_from_matrix(matrix: Any, axes: Axes = "sxyz") -> tuple[float, float, float]:
    """The three angles of a turn."""
    return angles_of(np.asarray(matrix, float).tolist(), axes)


def quaternion_matrix(quaternion: Numbers) -> Array:
    made = np.identity(4)
    made[:3, :3] = turn_of([float(part) for part in quaternion])
    return made


def quaternion_from_matrix(matrix: Any) -> tuple[float, float, float, float]:
    """The quaternion of a turn; the last number is not negative."""
    turn = np.asarray(matrix, float)[:3, :3]
    # The eigenvector of the largest eigenvalue: the nearest quaternion if the matrix is not quite a turn.
    (a, b, c), (d, e, f), (g, h, i) = turn.tolist()
    symmetric = np.array(
        [
            [a - e - i, 0.0, 0.0, 0.0],
            [d + b, e - a - i, 0.0, 0.0],
            [g + c, h + f, i - a - e, 0.0],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    _, vectors = np.linalg.eigh(symmetric)
    x, y, z, w = vectors[:, -1].tolist()
    return (-x, -y, -z, -w) if w < 0 else (x, y, z, w)


def quaternion_conjugate(quaternion: Numbers) -> Array:
    x, y, z, w = quaternion
    return np.array((-x, -y, -z, w), float)


def quaternion_inverse(quaternion: Numbers) -> Array:
    return np.asarray(quaternion_conjugate(quaternion) / np.dot(quaternion, quaternion))


def quaternion_slerp(
    quat0: Numbers, quat1: Numbers, fraction: float, spin: int = 0, shortestpath: bool = True
) -> Array:
    """Between two turns: the first at 0, the second at 1; `spin` more half turns on the way."""
    start, end = (np.asarray(unit_vector(one[:4])) for one in (quat0, quat1))
    along = float(start @ end)
    if fraction in (0.0, 1.0) or abs(abs(along) - 1.0) < 1e-15:
        return end if fraction == 1.0 else start
    if shortestpath and along < 0.0:
        along, end = -along, -end
    angle = math.acos(along) + spin * math.pi
    if abs(angle) < 1e-15:
        return start
    mixed = math.sin((1.0 - fraction) * angle) * start + math.sin(fraction * angle) * end
    return np.asarray(mixed / math.sin(angle))


def random_quaternion(rand: Numbers | None = None) -> Array:
    """Any turn, each as likely; `rand`: three numbers from 0 to 1 that it is made of."""
    first, second, third = np.random.rand(3) if rand is None else rand
    one, other = 2 * math.pi * second, 2 * math.pi * third
    small, large = math.sqrt(1.0 - first), math.sqrt(first)
    return np.array(
        (math.sin(one) * small, math.cos(one) * small, math.sin(other) * large, math.cos(other) * large)
    )


def random_rotation_matrix(rand: Numbers | None = None) -> Array:
    return quaternion_matrix(random_quaternion(rand))


# --- vectors


def random_vector(size: int | tuple[int, ...]) -> Array:
    """Numbers from 0 to 1."""
    return np.random.random(size)


def vector_norm(data: Any, axis: int | None = None, out: Array | None = None) -> Any:
    """The length, of vectors along `axis`; with `out` it is put there, and None returned."""
    values = np.asarray(data, float)
    if out is None:
        length = np.sqrt((values * values).sum(axis=axis))
        return float(length) if values.ndim == 1 else np.atleast_1d(length)
    np.sqrt((values * values).sum(axis=axis), out=out)
    return None


def unit_vector(data: Any, axis: int | None = None, out: Array | None = None) -> Any:
    """The same direction of length one; with `out` it is put there, and None returned."""
    values = np.array(data, float)
    length = np.sqrt((values * values).sum(axis=axis, keepdims=axis is not None))
    if out is None:
        return values / length if values.size else values
    out[...] = values / length
    return None
