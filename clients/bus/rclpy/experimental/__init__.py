"""What rclpy has on trial."""

from bus.rclpy.executors import EventsExecutor

__all__ = ["EventsExecutor"]
