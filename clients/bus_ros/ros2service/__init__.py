"""`ros2service` on the bus: `ros2service.api`, functions about services for programs that import them.

They work with any node: one of `rclpy`, or of `ros2cli.node`. Names, results and errors are
those of the same module in ros2cli (Jazzy).

Read first: `api.py`. Tests: `tests/system/test_ros2_tools.py`.
"""
