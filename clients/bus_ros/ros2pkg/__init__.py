"""`ros2pkg` on the bus: `ros2pkg.api`, functions about packages for programs that import them.

Read first: `api.py`. Tests: `tests/unit/bus_ros/ros2pkg/`.
"""
