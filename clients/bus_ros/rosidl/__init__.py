"""Message classes with the interface of ROS 2's Python, made from definitions: `std_msgs.msg.String`.

They are not the native classes (of bus.msg), but equal on the bus: same name, hash and bytes. This package is
below the facade of rclpy and above the type support; it must not know topics or nodes.

    definition (bus.types) --> `classes.py` --+-- `fields.py`, `numbers.py`  checks of assigned values
                                              +-- `message.py`               repr, comparison
                                              +-- `support.py` --> `wire.py` bytes, by the native class

Invariants:

- A class, its attributes, errors and `repr` look the same as classes that rosidl generates.
- The bytes equal the bytes of the native class of the same name, so programs of both kinds match.
- The native constructors and setters do the same as the compiled ones.
- Source is compiled only from definitions. Their grammar allows only plain identifiers.

Read first: `classes.py`. Tests: `tests/unit/bus_ros/rosidl/`, `tests/system/test_rosidl_topics.py`.
"""

from bus_ros.rosidl.classes import action_class, message_class, service_class
from bus_ros.rosidl.message import RosMessage

__all__ = ["RosMessage", "action_class", "message_class", "service_class"]
