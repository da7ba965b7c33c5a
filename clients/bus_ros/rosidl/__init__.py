"""Message classes as ROS 2's Python has them, made of definitions: `std_msgs.msg.String` of a program.

They are no native classes (those of bus.msg) but the same on the bus: name, hash and bytes. This package is
below the facade of rclpy and above the type support; it must not know topics or nodes.
"""

from bus_ros.rosidl.classes import action_class, message_class, service_class
from bus_ros.rosidl.message import RosMessage

__all__ = ["RosMessage", "action_class", "message_class", "service_class"]
