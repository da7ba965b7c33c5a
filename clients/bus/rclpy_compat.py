"""Importing this lets a program import `rclpy` and message packages without ROS 2; see docs/rclpy.md."""

from bus_ros.import_hook import install

__all__ = ["install"]
