"""`image_geometry` on the bus: pixels and directions of calibrated cameras, on NumPy.

cameramodels.py has both models and must not know topics and frames; undistortion.py removes the distortion of
a lens from a point. Only `rectify_image` needs OpenCV.

Invariants: results are the same as in ROS 2's package (image_geometry of vision_opencv). The
names of Jazzy and those of Humble exist.

Read first: `cameramodels.py`. Tests: `tests/unit/bus_ros/image_geometry/`.
"""

from bus_ros.image_geometry.cameramodels import PinholeCameraModel, StereoCameraModel

__all__ = ["PinholeCameraModel", "StereoCameraModel"]
