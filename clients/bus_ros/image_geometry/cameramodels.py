"""Models of calibrated cameras: which direction a pixel looks, and which pixel sees a point.

Coordinates of points are in the camera's optical frame: x to the right, y down, z forward. Pixels are (u, v)
of the rectified image, if no other is named.
"""

import copy
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bus_ros.extras import extra
from bus_ros.image_geometry.undistortion import undistorted

if TYPE_CHECKING:
    import numpy as np

    Matrix = np.ndarray[Any, Any]

__all__ = ["PinholeCameraModel", "StereoCameraModel"]

_NAME = "image_geometry"


class PinholeCameraModel:
    """One camera, described by a CameraInfo."""

    def __init__(self) -> None:
        self._k: Any = None
        self._d: Any = None
        self._r: Any = None
        self._p: Any = None
        self._full_k: Any = None
        self._full_p: Any = None
        self._width: Any = None
        self._height: Any = None
        self._binning_x: Any = None
        self._binning_y: Any = None
        self._raw_roi: Any = None
        self._tf_frame: Any = None
        self._stamp: Any = None

    def from_camera_info(self, msg: Any) -> None:
        """Take the parameters of a sensor_msgs/msg/CameraInfo."""
        self._full_k, self._full_p = _matrix(msg.k, 3, 3), _matrix(msg.p, 3, 4)
        self._r = _matrix(msg.r, 3, 3)
        self._d = _matrix(msg.d, len(msg.d), 1) if len(msg.d) else None
        self._width, self._height = msg.width, msg.height
        self._binning_x, self._binning_y = max(1, msg.binning_x), max(1, msg.binning_y)
        self._tf_frame, self._stamp = msg.header.frame_id, msg.header.stamp
        roi = self._raw_roi = copy.copy(msg.roi)
        if not (roi.x_offset or roi.y_offset or roi.width or roi.height):
            roi.width, roi.height = msg.width, msg.height
        self._k, self._p = self._full_k.copy(), self._full_p.copy()
        for matrix in (self._k, self._p):
            matrix[0, 0] /= self._binning_x
            matrix[1, 1] /= self._binning_y
            matrix[0, 2] = (matrix[0, 2] - roi.x_offset) / self._binning_x
            matrix[1, 2] = (matrix[1, 2] - roi.y_offset) / self._binning_y

    def rectify_image(self, raw: "Matrix", rectified: "Matrix") -> None:
        """Write the image `raw` without distortion into the image `rectified`. Needs OpenCV."""
        cv2 = extra("cv2", _NAME)
        size = (self._width, self._height)
        maps = cv2.initUndistortRectifyMap(self._k, self._d, self._r, self._p, size, cv2.CV_32FC1)
        self.mapx, self.mapy = maps
        cv2.remap(raw, self.mapx, self.mapy, cv2.INTER_CUBIC, rectified)

    def rectify_point(self, uv_raw: Sequence[float]) -> "Matrix":
        """The pixel of the rectified image for a pixel of the raw image."""
        np = extra("numpy", _NAME)
        k, d = self._k, self._d
        fx, fy, cx, cy = (float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        plane = ((uv_raw[0] - cx) / (fx or 1.0), (uv_raw[1] - cy) / (fy or 1.0))
        x, y = undistorted(*plane, () if d is None else d.ravel().tolist())
        u, v, w = self._p[:, :3] @ self._r @ np.array((x, y, 1.0))
        scale = 1 / w if w else 1.0
        return np.array((u * scale, v * scale))  # type: ignore[no-any-return]

    def project_3d_to_pixel(self, point: Sequence[float]) -> tuple[float, float]:
        """The pixel (u, v) that sees a point (x, y, z); not a number for a point in the camera's plane."""
        u, v, w = self._p @ _column(*point[:3], 1.0)
        return (u / w, v / w) if w else (math.nan, math.nan)

    def project_pixel_to_3d_ray(self, uv: Sequence[float]) -> tuple[float, float, float]:
        """The direction (x, y, z), of length 1, in which a pixel looks."""
        x = (uv[0] - self.cx()) / self.fx()
        y = (uv[1] - self.cy()) / self.fy()
        norm = math.sqrt(x * x + y * y + 1)
        return x / norm, y / norm, 1.0 / norm

    def get_delta_u(self, delta_x: float, z: float) -> float:
        """The pixels between two points at the distance `z` that are `delta_x` apart."""
        return math.inf if z == 0 else self.fx() * delta_x / z

    def get_delta_v(self, delta_y: float, z: float) -> float:
        """As `get_delta_u`, for y."""
        return math.inf if z == 0 else self.fy() * delta_y / z

    def get_delta_x(self, delta_u: float, z: float) -> float:
        """The length at the distance `z` that `delta_u` pixels show."""
        return z * delta_u / self.fx()

    def get_delta_y(self, delta_v: float, z: float) -> float:
        """As `get_delta_x`, for y."""
        return z * delta_v / self.fy()

    def full_resolution(self) -> tuple[int, int]:
        """Width and height of the camera's full image."""
        return self._width, self._height

    def intrinsic_matrix(self) -> "Matrix":
        """K, for this binning and region of interest."""
        return self._k  # type: ignore[no-any-return]

    def distortion_coeffs(self) -> "Matrix | None":
        """D, a column; None without distortion."""
        return self._d  # type: ignore[no-any-return]

    def rotation_matrix(self) -> "Matrix":
        """R."""
        return self._r  # type: ignore[no-any-return]

    def projection_matrix(self) -> "Matrix":
        """P, for this binning and region of interest."""
        return self._p  # type: ignore[no-any-return]

    def full_intrinsic_matrix(self) -> "Matrix":
        """K of the full image."""
        return self._full_k  # type: ignore[no-any-return]

    def full_projection_matrix(self) -> "Matrix":
        """P of the full image."""
        return self._full_p  # type: ignore[no-any-return]

    def cx(self) -> float:
        """The center of the image, in x."""
        return self._p[0, 2]  # type: ignore[no-any-return]

    def cy(self) -> float:
        """The center of the image, in y."""
        return self._p[1, 2]  # type: ignore[no-any-return]

    def fx(self) -> float:
        """The focal length in x, in pixels."""
        return self._p[0, 0]  # type: ignore[no-any-return]

    def fy(self) -> float:
        """The focal length in y, in pixels."""
        return self._p[1, 1]  # type: ignore[no-any-return]

    def tx(self) -> float:
        """P's translation in x: for the right camera of two, -fx * distance."""
        return self._p[0, 3]  # type: ignore[no-any-return]

    def ty(self) -> float:
        """P's translation in y."""
        return self._p[1, 3]  # type: ignore[no-any-return]

    def fov_x(self) -> float:
        """The horizontal field of view, in rad."""
        return 2 * math.atan(self._width / (2 * self.fx()))

    def fov_y(self) -> float:
        """The vertical field of view, in rad."""
        return 2 * math.atan(self._height / (2 * self.fy()))

    def get_tf_frame(self) -> str:
        """The frame of the camera."""
        return self._tf_frame  # type: ignore[no-any-return]

    # --- names of Humble. Matrices are numpy.matrix, as there

    fromCameraInfo = from_camera_info
    rectifyImage = rectify_image
    rectifyPoint = rectify_point
    project3dToPixel = project_3d_to_pixel
    projectPixelTo3dRay = project_pixel_to_3d_ray
    fullResolution = full_resolution
    tfFrame = get_tf_frame
    fovX = fov_x
    fovY = fov_y
    Tx = tx
    Ty = ty

    def getDeltaU(self, deltaX: float, Z: float) -> float:
        return self.get_delta_u(deltaX, Z)

    def getDeltaV(self, deltaY: float, Z: float) -> float:
        return self.get_delta_v(deltaY, Z)

    def getDeltaX(self, deltaU: float, Z: float) -> float:
        return self.get_delta_x(deltaU, Z)

    def getDeltaY(self, deltaV: float, Z: float) -> float:
        return self.get_delta_y(deltaV, Z)

    def intrinsicMatrix(self) -> Any:
        return _as_matrix(self._k)

    def distortionCoeffs(self) -> Any:
        return _as_matrix(self._d)

    def rotationMatrix(self) -> Any:
        return _as_matrix(self._r)

    def projectionMatrix(self) -> Any:
        return _as_matrix(self._p)

    def fullIntrinsicMatrix(self) -> Any:
        return _as_matrix(self._full_k)

    def fullProjectionMatrix(self) -> Any:
        return _as_matrix(self._full_p)

    K = property(intrinsicMatrix)
    D = property(distortionCoeffs)
    R = property(rotationMatrix)
    P = property(projectionMatrix)
    full_K = property(fullIntrinsicMatrix)
    full_P = property(fullProjectionMatrix)
    tf_frame = property(get_tf_frame)
    resolution = property(full_resolution)
    width = property(lambda self: self._width)
    height = property(lambda self: self._height)
    binning_x = property(lambda self: self._binning_x)
    binning_y = property(lambda self: self._binning_y)
    raw_roi = property(lambda self: self._raw_roi)
    stamp = property(lambda self: self._stamp)


class StereoCameraModel:
    """Two cameras side by side, with rectified images."""

    def __init__(self) -> None:
        self._left = PinholeCameraModel()
        self._right = PinholeCameraModel()
        self._q: Any = None

    def from_camera_info(self, left_msg: Any, right_msg: Any) -> None:
        """Take the parameters of both cameras."""
        np = extra("numpy", _NAME)
        self._left.from_camera_info(left_msg)
        self._right.from_camera_info(right_msg)
        right = self._right
        self._q = np.zeros((4, 4))
        self._q[0, 0] = self._q[1, 1] = 1.0
        self._q[0, 3], self._q[1, 3], self._q[2, 3] = -right.cx(), -right.cy(), right.fx()
        self._q[3, 2] = -right.fx() / right.tx()

    def get_tf_frame(self) -> str:
        """The frame of the left camera, and of points."""
        return self._left.get_tf_frame()

    def project_3d_to_pixel(self, point: Sequence[float]) -> tuple[tuple[float, float], tuple[float, float]]:
        """The pixels of the left and the right camera that see a point (x, y, z)."""
        return self._left.project_3d_to_pixel(point), self._right.project_3d_to_pixel(point)

    def project_pixel_to_3d(self, left_uv: Sequence[float], disparity: float) -> tuple[float, float, float]:
        """The point that the left camera sees at a pixel; zeros for the disparity 0."""
        x, y, z, w = self._q @ _column(*left_uv[:2], disparity, 1.0)
        return (x / w, y / w, z / w) if w else (0.0, 0.0, 0.0)

    def get_z(self, disparity: float) -> float:
        """The distance of a point with that disparity, in pixels."""
        return math.inf if disparity == 0 else -self._right.tx() / disparity

    def get_disparity(self, z: float) -> float:
        """The disparity, in pixels, of a point at that distance."""
        return math.inf if z == 0 else -self._right.tx() / z

    def get_left_camera(self) -> PinholeCameraModel:
        """The left camera."""
        return self._left

    def get_right_camera(self) -> PinholeCameraModel:
        """The right camera."""
        return self._right

    # --- names of Humble

    fromCameraInfo = from_camera_info
    tfFrame = get_tf_frame
    project3dToPixel = project_3d_to_pixel
    projectPixelTo3d = project_pixel_to_3d
    getZ = get_z

    def getDisparity(self, Z: float) -> float:
        return self.get_disparity(Z)

    left = property(get_left_camera)
    right = property(get_right_camera)
    Q = property(lambda self: self._q)


def _matrix(values: Any, rows: int, columns: int) -> "Matrix":
    np = extra("numpy", _NAME)
    return np.array(values, dtype="float64").reshape(rows, columns)  # type: ignore[no-any-return]


def _column(*values: float) -> "Matrix":
    return extra("numpy", _NAME).array(values, dtype="float64")  # type: ignore[no-any-return]


def _as_matrix(values: "Matrix | None") -> Any:
    return None if values is None else extra("numpy", _NAME).asmatrix(values)
