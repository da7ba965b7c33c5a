"""Message classes as ROS 2's Python has them, made of definitions: `std_msgs.msg.String` of a program.

They are no native classes (those of bus.msg) but the same on the bus: name, hash and bytes. This package is
below the facade of rclpy and above the type support; it must not know topics or nodes.

    definition (bus.types) --> `classes.py` --+-- `fields.py`, `numbers.py`  checks of what is assigned
                                              +-- `message.py`               repr, comparison
                                              +-- `support.py` --> `wire.py` bytes, by the native class

Invariants:

- A class, its attributes, errors and `repr` look as if rosidl had made them.
- The bytes are those of the native class of the same name, so programs of both kinds match.
- Source is compiled only from definitions, whose grammar allows plain identifiers only.

Read first: `classes.py`. Tests: `tests/unit/bus_ros/rosidl/`, `tests/system/test_rosidl_topics.py`.
"""

from bus_ros.rosidl.classes import action_class, message_class, service_class
from bus_ros.rosidl.message import RosMessage

__all__ = ["RosMessage", "action_class", "message_class", "service_class"]
