"""`ros2interface` on the bus: `ros2interface.api`, functions about definitions for programs that import them.

Read first: `api.py`. Tests: `tests/unit/bus_ros/ros2interface/`.
"""
