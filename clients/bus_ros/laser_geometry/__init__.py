"""`laser_geometry` on the bus: laser scans as point clouds, on NumPy, which is imported when it is needed.

One module, which must not know topics and frames. Points and channels are the same as in ROS 2's package.

Read first: `laser_geometry.py`. Tests: `tests/unit/bus_ros/laser_geometry/`.
"""

from bus_ros.laser_geometry.laser_geometry import LaserProjection

__all__ = ["LaserProjection"]
