"""`ros2lifecycle` on the bus: `ros2lifecycle.api`, calls of lifecycle nodes for programs that import them.

They work with any node: one of `rclpy`, or of `ros2cli.node`. Names and results are
those of the same module in ros2cli (Jazzy).

Read first: `api.py`. Tests: `tests/system/test_ros2_tools.py`.
"""
