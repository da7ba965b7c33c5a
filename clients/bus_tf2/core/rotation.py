"""Rotations as quaternions (x, y, z, w), places as vectors: the computations of frames.h, in plain Python."""

from math import acos, cos, sin, sqrt
from typing import Final

__all__ = [
    "IDENTITY",
    "Matrix",
    "Quaternion",
    "Transform",
    "Vector",
    "composed",
    "dot",
    "from_angles",
    "inverse",
    "inverted",
    "matrix",
    "multiply",
    "normal",
    "rotate",
    "slerp",
]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Transform = tuple[Vector, Quaternion]
Matrix = tuple[Vector, Vector, Vector]
"""The rows of a matrix."""

IDENTITY: Final[Transform] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def inverse(q: Quaternion) -> Quaternion:
    """The inverse of a rotation with length one."""
    return -q[0], -q[1], -q[2], q[3]


def dot(a: Quaternion, b: Quaternion) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


def rotate(q: Quaternion, v: Vector) -> Vector:
    x, y, z, _ = multiply(multiply(q, (*v, 0.0)), inverse(q))
    return x, y, z


def inverted(of: Transform) -> Transform:
    (x, y, z), rotation = of
    back = inverse(rotation)
    return rotate(back, (-x, -y, -z)), back


def composed(outer: Transform, inner: Transform) -> Transform:
    """The rotation that does `inner` first, and then `outer`."""
    (x, y, z), (by_x, by_y, by_z) = rotate(outer[1], inner[0]), outer[0]
    return (x + by_x, y + by_y, z + by_z), normal(multiply(outer[1], inner[1]))


def from_angles(roll: float, pitch: float, yaw: float) -> Quaternion:
    """The rotation about x, then y, then z, with fixed axes."""
    sr, cr, sp, cp = sin(roll / 2), cos(roll / 2), sin(pitch / 2), cos(pitch / 2)
    sy, cy = sin(yaw / 2), cos(yaw / 2)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def matrix(q: Quaternion) -> Matrix:
    """The inverse of a rotation with any length except zero."""
    x, y, z, w = q
    s = 2.0 / dot(q, q)
    xs, ys, zs = x * s, y * s, z * s
    return (
        (1.0 - (y * ys + z * zs), x * ys - w * zs, x * zs + w * ys),
        (x * ys + w * zs, 1.0 - (x * xs + z * zs), y * zs - w * xs),
        (x * zs - w * ys, y * zs + w * xs, 1.0 - (x * xs + y * ys)),
    )


def normal(q: Quaternion) -> Quaternion:
    """The same rotation of length one, with the sign that a rotation matrix gives."""
    rows = matrix(q)
    trace = rows[0][0] + rows[1][1] + rows[2][2]
    if trace > 0.0:
        s = sqrt(trace + 1.0)
        w, s = s * 0.5, 0.5 / s
        return (rows[2][1] - rows[1][2]) * s, (rows[0][2] - rows[2][0]) * s, (rows[1][0] - rows[0][1]) * s, w
    i = 1 if rows[0][0] < rows[1][1] else 0
    if rows[i][i] < rows[2][2]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    s = sqrt(rows[i][i] - rows[j][j] - rows[k][k] + 1.0)
    parts = [0.0, 0.0, 0.0]
    parts[i], s = s * 0.5, 0.5 / s
    parts[j], parts[k] = (rows[j][i] + rows[i][j]) * s, (rows[k][i] + rows[i][k]) * s
    return parts[0], parts[1], parts[2], (rows[k][j] - rows[j][k]) * s


def slerp(a: Quaternion, b: Quaternion, ratio: float) -> Quaternion:
    """A rotation between two rotations of length one, on the shorter way: `a` at 0, `b` at 1."""
    along = dot(a, b)
    theta = acos(min(1.0, abs(along) / sqrt(dot(a, a) * dot(b, b))))
    if theta == 0.0:
        return a
    d = 1.0 / sin(theta)
    s0 = sin((1.0 - ratio) * theta) * d
    s1 = (-1.0 if along < 0.0 else 1.0) * sin(ratio * theta) * d
    return a[0] * s0 + b[0] * s1, a[1] * s0 + b[1] * s1, a[2] * s0 + b[2] * s1, a[3] * s0 + b[3] * s1
