"""`ros2action` on the bus: `ros2action.api`, functions about actions for programs that import them.

They work with any node: one of `rclpy`, or of `ros2cli.node`. Names, results and errors are ROS 2's.

Read first: `api.py`. Tests: `tests/system/test_ros2_tools.py`.
"""
