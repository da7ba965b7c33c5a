"""The steps of a conversion on arrays: by OpenCV if it is installed, otherwise by NumPy if possible."""

from functools import cache
from typing import TYPE_CHECKING, Any

from bus_ros.cv_bridge.encodings import Color, CvBridgeError, Depth
from bus_ros.extras import extra

if TYPE_CHECKING:
    import numpy as np

    Image = np.ndarray[Any, Any]

__all__ = ["apply", "cv2"]


def apply(step: Color | Depth, image: "Image") -> "Image":
    """Apply a step; returns a new image.

    Raises CvBridgeError with OpenCV's text if OpenCV refuses, ModuleNotFoundError if OpenCV is needed and not
    installed.
    """
    return _scaled(step, image) if isinstance(step, Depth) else _colored(step, image)


@cache
def cv2() -> Any:
    """The module cv2, or None if it is not installed."""
    try:
        return extra("cv2", "cv_bridge")
    except ModuleNotFoundError:
        return None


def _scaled(step: Depth, image: "Image") -> "Image":
    np = extra("numpy", "cv_bridge")
    if np.issubdtype(step.dtype, np.floating) or (step.scale == 1 and np.can_cast(image.dtype, step.dtype)):
        found: Image = image.astype(step.dtype)
        return found * np.dtype(step.dtype).type(step.scale) if step.scale != 1 else found
    limits = np.iinfo(step.dtype)
    exact = np.float32 if image.itemsize <= 2 else np.float64
    numbers = np.multiply(image, exact(step.scale), dtype=exact)
    if np.issubdtype(image.dtype, np.floating):
        numbers[np.isnan(numbers)] = 0
    np.clip(np.rint(numbers, out=numbers), limits.min, limits.max, out=numbers)
    cut: Image = numbers.astype(step.dtype)
    return cut


def _colored(step: Color, image: "Image") -> "Image":
    opencv = cv2()
    if opencv is None:
        return _reordered(step, image)
    try:
        found: Image = opencv.cvtColor(image, getattr(opencv, step.code))
    except opencv.error as error:
        raise CvBridgeError(str(error).strip()) from error
    return found


def _reordered(step: Color, image: "Image") -> "Image":
    """Reorder, add or drop channels: the conversions without arithmetic."""
    np = extra("numpy", "cv_bridge")
    if not {step.source, step.target} <= _ORDERS.keys() or step.target == "GRAY":
        extra("cv2", f"cv_bridge from {step.source} to {step.target}")
    source = _ORDERS[step.source]
    planes = []
    for channel in _ORDERS[step.target]:
        if step.source == "GRAY" and channel != "A":
            planes.append(image)
        elif channel in source:
            planes.append(image[..., source.index(channel)])
        else:
            planes.append(np.full(image.shape[:2], np.iinfo(image.dtype).max, image.dtype))
    stacked: Image = np.stack(planes, axis=-1)
    return stacked


_ORDERS = {"GRAY": "", "RGB": "RGB", "BGR": "BGR", "RGBA": "RGBA", "BGRA": "BGRA"}
"""The channels of each kind, in order. A GRAY image has no separate channels: it is a single plane."""
