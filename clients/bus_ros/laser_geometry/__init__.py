"""`laser_geometry` on the bus: laser scans as point clouds, on NumPy, which is imported when it is needed."""

from bus_ros.laser_geometry.laser_geometry import LaserProjection

__all__ = ["LaserProjection"]
