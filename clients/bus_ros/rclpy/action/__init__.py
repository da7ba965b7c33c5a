"""Actions, which busd does not have: programs can import the names, and are told what is missing."""

from bus_ros.rclpy.action.client import ActionClient
from bus_ros.rclpy.action.server import ActionServer, CancelResponse, GoalResponse

__all__ = ["ActionClient", "ActionServer", "CancelResponse", "GoalResponse"]
