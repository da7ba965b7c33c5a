"""`cv_bridge` on the bus: images in messages as arrays, and back.

`encodings.py` (pure) finds the steps from one encoding to another, `pixels.py` applies them to arrays, with
OpenCV or with NumPy alone, `core.py` has `CvBridge`.

Invariants: results and errors are the same as in ROS 2's cv_bridge; NumPy and OpenCV are imported only when
an image is converted; without OpenCV, all conversions that NumPy can do still work.

Read first: `encodings.py`. Tests: `tests/unit/bus_ros/cv_bridge/`.
"""

from bus_ros.cv_bridge.core import CvBridge
from bus_ros.cv_bridge.encodings import CvBridgeError

__all__ = ["CvBridge", "CvBridgeError"]
