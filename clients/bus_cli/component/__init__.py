"""Verbs of `bus component`: node classes in a running container.

`remote.py` finds containers and calls their services. The container itself is a program of
`bus_ros.rclpy_components`; a container of ROS 2 has the same services.

Invariant: verbs print the same lines as `ros2 component`.

Read first: `remote.py`. Tests: `tests/system/test_cli_component.py`.
"""
