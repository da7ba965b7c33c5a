"""Removes the distortion of a lens from a point, by the same steps as OpenCV's undistortPoints. Pure.

The order of coefficients is OpenCV's: k1, k2, p1, p2, k3 to k6, s1 to s4.
"""

from collections.abc import Sequence
from typing import Final

__all__ = ["MOST_COEFFICIENTS", "undistorted"]

MOST_COEFFICIENTS: Final = 12
_STEPS: Final = 5
"""OpenCV's number of steps. It does not look whether the result still changes."""


def undistorted(x0: float, y0: float, coefficients: Sequence[float]) -> tuple[float, float]:
    """The point without distortion. Both points are in the plane at distance 1.

    Raises ValueError for more coefficients than MOST_COEFFICIENTS (a tilted sensor).
    """
    if len(coefficients) > MOST_COEFFICIENTS:
        text = (
            f"a camera with {len(coefficients)} coefficients of distortion, not at most {MOST_COEFFICIENTS}"
        )
        raise ValueError(f"{text}, is not supported")
    given = (*coefficients, *[0.0] * (MOST_COEFFICIENTS - len(coefficients)))
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = given
    x, y = x0, y0
    for _ in range(_STEPS):
        r2 = x * x + y * y
        scale = (1 + ((k6 * r2 + k5) * r2 + k4) * r2) / (1 + ((k3 * r2 + k2) * r2 + k1) * r2)
        if scale < 0:
            return x0, y0
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + (s2 * r2 + s1) * r2
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + (s4 * r2 + s3) * r2
        x, y = (x0 - dx) * scale, (y0 - dy) * scale
    return x, y
