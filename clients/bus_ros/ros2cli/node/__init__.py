"""`ros2cli.node`: the nodes of tools, with names that tools hide.

Read first: `direct.py`. Tests: `tests/system/test_ros2_tools.py`.
"""

from bus_ros.rclpy.node import HIDDEN_NODE_PREFIX

__all__ = ["HIDDEN_NODE_PREFIX", "NODE_NAME_PREFIX"]

NODE_NAME_PREFIX = f"{HIDDEN_NODE_PREFIX}ros2cli"
