"""`cv_bridge` on the bus: images in messages as arrays, and back."""

from bus_ros.cv_bridge.core import CvBridge
from bus_ros.cv_bridge.encodings import CvBridgeError

__all__ = ["CvBridge", "CvBridgeError"]
