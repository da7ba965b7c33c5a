"""`ros2run` on the bus: `ros2run.api`, which finds and runs the programs of packages.

Read first: `api.py`. Tests: `tests/unit/bus_ros/ros2run/`.
"""
