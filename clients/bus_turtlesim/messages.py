"""The types that turtlesim speaks, as classes."""

from typing import Any

from bus_ros.rosidl import action_class, message_class, service_class

__all__ = [
    "Color",
    "Empty",
    "IntegerRange",
    "Kill",
    "ParameterDescriptor",
    "Pose",
    "RotateAbsolute",
    "SetPen",
    "Spawn",
    "TeleportAbsolute",
    "TeleportRelative",
    "Twist",
]

Color: Any = message_class("turtlesim/msg/Color")
Pose: Any = message_class("turtlesim/msg/Pose")
Twist: Any = message_class("geometry_msgs/msg/Twist")
IntegerRange: Any = message_class("rcl_interfaces/msg/IntegerRange")
ParameterDescriptor: Any = message_class("rcl_interfaces/msg/ParameterDescriptor")
Empty: Any = service_class("std_srvs/srv/Empty")
Kill: Any = service_class("turtlesim/srv/Kill")
SetPen: Any = service_class("turtlesim/srv/SetPen")
Spawn: Any = service_class("turtlesim/srv/Spawn")
TeleportAbsolute: Any = service_class("turtlesim/srv/TeleportAbsolute")
TeleportRelative: Any = service_class("turtlesim/srv/TeleportRelative")
RotateAbsolute: Any = action_class("turtlesim/action/RotateAbsolute")
