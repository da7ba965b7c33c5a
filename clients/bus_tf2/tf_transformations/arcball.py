"""A ball that a pointer turns: the picture on a screen turns with it."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from bus_tf2.tf_transformations.angles import quaternion_multiply
from bus_tf2.tf_transformations.matrices import (
    Array,
    Numbers,
    quaternion_from_matrix,
    quaternion_matrix,
    quaternion_slerp,
    unit_vector,
)

__all__ = ["Arcball", "arcball_constrain_to_axis", "arcball_map_to_sphere", "arcball_nearest_axis"]

_EPS = 1e-15


class Arcball:
    """Turns from the pointer's place at `down` to the place to which it is dragged.

    `initial`: a matrix or a quaternion to begin with. The ball has the radius 1 around the origin, unless
    `place` puts it elsewhere on the screen.
    """

    def __init__(self, initial: Any = None) -> None:
        self._center: Sequence[float] = (0.0, 0.0)
        self._radius = 1.0
        self._axes: list[Array] | None = None
        self._axis: Array | None = None
        self._is_constrained = False
        self._from = np.array((0.0, 0.0, 1.0))
        begin = np.array((0.0, 0.0, 0.0, 1.0)) if initial is None else np.array(initial, float)
        if begin.shape == (4, 4):
            begin = np.array(quaternion_from_matrix(begin))
        elif begin.shape != (4,):
            raise ValueError("initial not a quaternion or matrix")
        self._at_down = self._before = self._now = np.asarray(unit_vector(begin))

    def place(self, center: Sequence[float], radius: float) -> None:
        """The place of the ball, in the pointer's coordinates."""
        self._center, self._radius = (center[0], center[1]), float(radius)

    def setaxes(self, *axes: Numbers) -> None:
        """The axes that a constrained ball turns about; none: it turns freely."""
        self._axes = [np.asarray(unit_vector(axis)) for axis in axes] or None

    def setconstrain(self, constrain: bool) -> None:
        """Whether it turns about the nearest of its axes only."""
        self._is_constrained = bool(constrain)

    def getconstrain(self) -> bool:
        return self._is_constrained

    def down(self, point: Sequence[float]) -> None:
        """The pointer takes hold."""
        self._from = arcball_map_to_sphere(point, self._center, self._radius)
        self._at_down = self._before = self._now
        self._axis = None
        if self._is_constrained and self._axes:
            self._axis = arcball_nearest_axis(self._from, self._axes)
            self._from = arcball_constrain_to_axis(self._from, self._axis)

    def drag(self, point: Sequence[float]) -> None:
        """The pointer is there now."""
        to = arcball_map_to_sphere(point, self._center, self._radius)
        if self._axis is not None:
            to = arcball_constrain_to_axis(to, self._axis)
        self._before = self._now
        turn = np.cross(self._from, to)
        if turn @ turn < _EPS:
            self._now = self._at_down
        else:
            step = [*turn.tolist(), float(self._from @ to)]
            self._now = np.array(quaternion_multiply(step, self._at_down.tolist()), float)

    def next(self, acceleration: float = 0.0) -> None:
        """Turn on as in the last step."""
        on = quaternion_slerp(self._before, self._now, 2.0 + acceleration, shortestpath=False)
        self._before, self._now = self._now, on

    def matrix(self) -> Array:
        """The turn until now."""
        return quaternion_matrix(self._now)


def arcball_map_to_sphere(point: Sequence[float], center: Sequence[float], radius: float) -> Array:
    """The place on the unit sphere below a point of a screen. The screen's y axis points down."""
    x, y = (point[0] - center[0]) / radius, (center[1] - point[1]) / radius
    away = math.hypot(x, y)
    if away > 1.0:
        return np.array((x / away, y / away, 0.0))
    return np.array((x, y, math.sqrt(1.0 - away * away)))


def arcball_constrain_to_axis(point: Numbers, axis: Numbers) -> Array:
    """The nearest place of the upper half of the great circle that the axis stands on."""
    along = np.array(axis, float)
    place = np.array(point, float)
    place -= along * (along @ place)
    length = float(np.linalg.norm(place))
    if length > _EPS:
        return np.asarray((-place if place[2] < 0.0 else place) / length)
    if along[2] == 1.0:
        return np.array((1.0, 0.0, 0.0))
    return np.asarray(unit_vector((-along[1], along[0], 0.0)))


def arcball_nearest_axis(point: Numbers, axes: Sequence[Any]) -> Any:
    """The axis with the great circle nearest to a place."""
    place = np.array(point, float)
    return max(axes, key=lambda axis: float(arcball_constrain_to_axis(place, axis) @ place))
