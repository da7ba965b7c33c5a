"""Points without the distortion of a lens. The results are those of OpenCV's undistortPoints."""

import pytest

from bus_ros.image_geometry.undistortion import MOST_COEFFICIENTS, undistorted
from rows import for_each


@for_each("coefficients", [(), (0.0,) * 4, (0.0,) * MOST_COEFFICIENTS])
def test_no_distortion(coefficients: tuple[float, ...]) -> None:
    assert undistorted(0.5, -0.25, coefficients) == (0.5, -0.25)


def test_too_many_coefficients() -> None:
    with pytest.raises(ValueError, match="with 14 coefficients of distortion, not at most 12, is not supp"):
        undistorted(0.0, 0.0, (0.0,) * 14)


def test_a_scale_below_zero_changes_nothing() -> None:
    assert undistorted(1.0, 1.0, (-3.0, 0.0, 0.0, 0.0)) == (1.0, 1.0)


@for_each(
    ("coefficients", "point"),
    [
        ((-0.36, 0.16, -8e-05, -0.0004), (0.3153968598, -0.2102122239)),
        ((-0.36, 0.16, -8e-05, -0.0004, 0.01), (0.3153859965, -0.2102049871)),
        ((0.2, -0.1, 0.001, 0.002, 0.02, 0.1, -0.05, 0.01), (0.2960351909, -0.1976487711)),
        (
            (0.2, -0.1, 0.001, 0.002, 0.02, 0.1, -0.05, 0.01, 0.01, -0.02, 0.03, 0.04),
            (0.2950666981, -0.2020676240),
        ),
    ],
)
def test_the_results_are_those_of_opencv(coefficients: tuple[float, ...], point: tuple[float, float]) -> None:
    assert undistorted(0.3, -0.2, coefficients) == pytest.approx(point, abs=1e-9)
