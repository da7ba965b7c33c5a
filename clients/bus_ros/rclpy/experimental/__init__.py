"""What rclpy has on trial."""

from bus_ros.rclpy.executors import EventsExecutor

__all__ = ["EventsExecutor"]
