"""Models of cameras. The numbers of the two cameras are a real calibration's."""

import math
from typing import Any

import pytest

from bus_ros.image_geometry import PinholeCameraModel, StereoCameraModel
from bus_ros.rosidl import message_class
from rows import for_each

np = pytest.importorskip("numpy")
CameraInfo: Any = message_class("sensor_msgs/msg/CameraInfo")
close = pytest.approx

FX, CX, CY, BASE = 295.534, 285.558, 223.296, -26.508


def camera_info(baseline: float = 0.0, **fields: Any) -> Any:
    made = CameraInfo(
        width=640,
        height=480,
        d=[-0.3635, 0.1612, -8.11e-05, -0.000448, 0.0],
        k=[430.154, 0.0, 311.713, 0.0, 430.609, 221.068, 0.0, 0.0, 1.0],
        r=[0.998066, 0.006856, 0.06179, -0.006752, 0.999975, -0.001891, -0.061802, 0.00147, 0.998087],
        p=[FX, 0.0, CX, baseline, 0.0, FX, CY, 0.0, 0.0, 0.0, 1.0, 0.0],
        **fields,
    )
    made.header.frame_id = "right" if baseline else "left"
    made.header.stamp.sec = 7
    return made


def pinhole(**fields: Any) -> PinholeCameraModel:
    camera = PinholeCameraModel()
    camera.from_camera_info(camera_info(**fields))
    return camera


def stereo() -> StereoCameraModel:
    cameras = StereoCameraModel()
    cameras.from_camera_info(camera_info(), camera_info(BASE))
    return cameras


def test_what_a_message_says() -> None:
    camera = pinhole()
    assert (camera.fx(), camera.fy(), camera.cx(), camera.cy()) == (FX, FX, CX, CY)
    assert (camera.tx(), camera.ty()) == (0.0, 0.0)
    assert camera.full_resolution() == (640, 480)
    assert camera.get_tf_frame() == "left"
    assert camera.intrinsic_matrix()[0].tolist() == [430.154, 0.0, 311.713]
    assert camera.projection_matrix().shape == (3, 4)
    assert camera.rotation_matrix()[2].tolist() == [-0.061802, 0.00147, 0.998087]
    coefficients = camera.distortion_coeffs()
    assert coefficients is not None
    assert coefficients.shape == (5, 1)
    assert camera.fov_x() == close(2 * math.atan(320 / FX))
    assert camera.fov_y() == close(2 * math.atan(240 / FX))


def test_a_camera_without_distortion() -> None:
    info = camera_info()
    info.d = []
    camera = PinholeCameraModel()
    camera.from_camera_info(info)
    assert camera.distortion_coeffs() is None
    assert camera.D is None


def test_binning_and_region_of_interest() -> None:
    info = camera_info(binning_x=2, binning_y=4)
    info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = 100, 40, 200, 100
    camera = PinholeCameraModel()
    camera.from_camera_info(info)
    assert camera.fx() == close(FX / 2)
    assert camera.fy() == close(FX / 4)
    assert camera.cx() == close((CX - 100) / 2)
    assert camera.cy() == close((CY - 40) / 4)
    assert camera.intrinsic_matrix()[1, 2] == close((221.068 - 40) / 4)
    assert camera.full_intrinsic_matrix()[1, 2] == 221.068
    assert camera.full_projection_matrix()[0, 0] == FX
    assert info.k[0] == 430.154
    assert (camera.binning_x, camera.binning_y, camera.raw_roi.width) == (2, 4, 200)
    assert pinhole().raw_roi.width == 640


def test_pixels_and_points() -> None:
    camera = pinhole()
    assert camera.project_3d_to_pixel((1.0, 2.0, 3.0)) == close((384.069, 420.319), abs=1e-3)
    ray = camera.project_pixel_to_3d_ray((1.0, 2.0))
    assert ray == close((-0.6103, -0.4747, 0.6339), abs=1e-3)
    assert math.hypot(*ray) == close(1.0)
    assert camera.project_3d_to_pixel(ray) == close((1.0, 2.0))
    assert all(map(math.isnan, camera.project_3d_to_pixel((1.0, 2.0, 0.0))))


def test_lengths() -> None:
    camera = pinhole()
    assert camera.get_delta_u(1.0, 2.0) == camera.get_delta_v(1.0, 2.0) == close(FX / 2)
    assert camera.get_delta_x(FX, 2.0) == camera.get_delta_y(FX, 2.0) == close(2.0)
    assert camera.get_delta_u(1.0, 0.0) == camera.get_delta_v(1.0, 0.0) == math.inf


@for_each(
    ("raw", "rectified"),
    [
        ((1.0, 2.0), (48.18711837, 45.50738629)),
        ((320.0, 240.0), (309.66922391, 235.74078878)),
        ((639.0, 479.0), (601.57351982, 453.25285444)),
    ],
)
def test_a_rectified_point(raw: tuple[float, float], rectified: tuple[float, float]) -> None:
    """The results are OpenCV's."""
    assert pinhole().rectify_point(raw) == close(rectified, abs=1e-6)


def test_a_rectified_image_needs_opencv(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    image = np.zeros((480, 640), np.uint8)
    with pytest.raises(ModuleNotFoundError, match="image_geometry needs OpenCV"):
        pinhole().rectify_image(image, image)


def test_a_rectified_image() -> None:
    pytest.importorskip("cv2")
    raw = np.fromfunction(lambda i, j: (i + j) % 256, (480, 640)).astype(np.uint8)
    rectified = np.zeros_like(raw)
    pinhole().rectify_image(raw, rectified)
    assert rectified[56, 47] == close(12, abs=1)


def test_two_cameras() -> None:
    cameras = stereo()
    for disparity in (1.0, 4.5):
        point = cameras.project_pixel_to_3d((320.0, 16.0), disparity)
        assert point[2] == close(cameras.get_z(disparity)) == close(-BASE / disparity)
        assert cameras.get_disparity(point[2]) == close(disparity)
        left, right = cameras.project_3d_to_pixel(point)
        assert left == close((320.0, 16.0))
        assert right == close((320.0 - disparity, 16.0))
    assert cameras.project_pixel_to_3d((1.0, 2.0), 0.0) == (0.0, 0.0, 0.0)
    assert cameras.get_z(0) == cameras.get_disparity(0) == math.inf
    assert cameras.get_tf_frame() == cameras.get_left_camera().get_tf_frame() == "left"
    assert cameras.get_right_camera().tx() == BASE


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
def test_names_of_humble() -> None:
    camera = PinholeCameraModel()
    camera.fromCameraInfo(camera_info())
    assert np.allclose(camera.K * camera.K.I, np.eye(3))
    assert isinstance(camera.P, np.matrix)
    assert camera.full_P.shape == camera.fullProjectionMatrix().shape == (3, 4)
    assert camera.full_K.tolist() == camera.intrinsicMatrix().tolist()
    assert camera.R.tolist() == camera.rotationMatrix().tolist()
    assert camera.distortionCoeffs().shape == (5, 1)
    assert (camera.width, camera.height, camera.resolution) == (640, 480, (640, 480))
    assert (camera.tf_frame, camera.tfFrame(), camera.stamp.sec) == ("left", "left", 7)
    assert camera.project3dToPixel((0, 0, 1)) == (CX, CY)
    assert camera.projectPixelTo3dRay((CX, CY)) == (0.0, 0.0, 1.0)
    assert camera.getDeltaU(deltaX=1.0, Z=1.0) == camera.getDeltaV(1.0, 1.0) == FX
    assert camera.getDeltaX(FX, 1.0) == camera.getDeltaY(deltaV=FX, Z=1.0) == 1.0
    assert camera.Tx() == camera.Ty() == 0.0
    assert (camera.fovX(), camera.fovY()) == (camera.fov_x(), camera.fov_y())
    cameras = StereoCameraModel()
    cameras.fromCameraInfo(camera_info(), camera_info(BASE))
    assert cameras.left.tfFrame() == cameras.tfFrame() == "left"
    assert cameras.right.Tx() == BASE
    assert cameras.Q[3, 2] == close(-FX / BASE)
    assert cameras.getDisparity(Z=cameras.getZ(2.0)) == close(2.0)
    point = cameras.projectPixelTo3d((1.0, 2.0), 3.0)
    assert cameras.project3dToPixel(point)[0] == close((1.0, 2.0))
