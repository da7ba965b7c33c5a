"""Quaternions (x, y, z, w) and Euler angles of any sequence of axes, in plain Python.

A sequence is `s` for axes that stay or `r` for axes that turn along, and three letters: `sxyz` is roll, pitch
and yaw. Must not know NumPy, which takes long to import.
"""

from collections.abc import Sequence
from math import atan2, cos, hypot, sin, sqrt
from typing import Any, Final

from bus_tf2.core.rotation import Matrix, Quaternion, Vector, dot, matrix, multiply

__all__ = [
    "angles_of",
    "euler_from_quaternion",
    "quaternion_about_axis",
    "quaternion_from_euler",
    "quaternion_multiply",
    "turn_of",
]

_EPS: Final = 8.9e-16
_IDENTITY: Final[Matrix] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

Axes = str | Sequence[int]
"""`sxyz`, or the older form: first axis, parity, repetition, frame."""


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Axes = "sxyz") -> Quaternion:
    """The quaternion of three angles. Raises ValueError for an unknown sequence of axes."""
    letters, is_rotating = _read(axes)
    q: Quaternion = (0.0, 0.0, 0.0, 1.0)
    for axis, angle in zip(letters, (ai, aj, ak), strict=True):
        half = float(angle) / 2
        parts = [0.0, 0.0, 0.0]
        parts[axis] = sin(half)
        step = (parts[0], parts[1], parts[2], cos(half))
        q = multiply(q, step) if is_rotating else multiply(step, q)
    return q


def euler_from_quaternion(quaternion: Sequence[float], axes: Axes = "sxyz") -> Vector:
    """The three angles of a quaternion of any length; of none for one of length zero."""
    return angles_of(turn_of(quaternion), axes)


def quaternion_about_axis(angle: float, axis: Sequence[float]) -> Quaternion:
    """The quaternion of a turn about an axis; its length must not be zero."""
    x, y, z = map(float, axis)
    scale = sin(angle / 2) / sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale, cos(angle / 2)


def quaternion_multiply(quaternion1: Sequence[float], quaternion0: Sequence[float]) -> Quaternion:
    """The product: it turns by the second quaternion first, and then by the first."""
    return multiply(_quaternion(quaternion1), _quaternion(quaternion0))


def turn_of(quaternion: Sequence[float]) -> Matrix:
    """The rows of a quaternion's rotation matrix."""
    q = _quaternion(quaternion)
    return matrix(q) if dot(q, q) > _EPS else _IDENTITY


def angles_of(turn: Any, axes: Axes = "sxyz") -> Vector:
    """The three angles of a rotation matrix, of which the upper left 3 x 3 count."""
    letters, is_rotating = _read(axes)
    i, j, k = reversed(letters) if is_rotating else letters
    is_repeated = i == k
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    if is_repeated:
        beside = hypot(turn[i][j], turn[i][k])
        first = atan2(turn[i][j], turn[i][k])
        second = atan2(beside, turn[i][i])
        third = atan2(turn[j][i], -turn[k][i])
    else:
        beside = hypot(turn[i][i], turn[j][i])
        first = atan2(turn[k][j], turn[k][k])
        second = atan2(-turn[k][i], beside)
        third = atan2(turn[j][i], turn[i][i])
    if beside <= _EPS:  # the first axis lies on the third: one of the two angles is free
        first, third = atan2(-turn[j][k], turn[j][j]), 0.0
    angles = (sign * first, sign * second, sign * third)
    return angles[::-1] if is_rotating else angles


def _quaternion(of: Sequence[float]) -> Quaternion:
    x, y, z, w = map(float, of)
    return x, y, z, w


def _read(axes: Axes) -> tuple[tuple[int, int, int], bool]:
    """The three axes in the order of the angles, and whether they turn along."""
    if not isinstance(axes, str):
        first, parity, repetition, frame = axes
        second = (first + (2 if parity else 1)) % 3
        third = first if repetition else 3 - first - second
        return ((third, second, first) if frame else (first, second, third)), bool(frame)
    letters = ["xyz".find(letter) for letter in axes[1:].lower()]
    is_known = len(letters) == 3 and min(letters) >= 0 and letters[1] not in letters[::2]
    if axes[:1] not in ("s", "r") or not is_known:
        raise ValueError(f"{axes!r} is no sequence of axes: 's' or 'r' and three of x, y, z, like 'sxyz'")
    return (letters[0], letters[1], letters[2]), axes[0] == "r"
