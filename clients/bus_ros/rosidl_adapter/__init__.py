"""`rosidl_adapter` on the bus: `rosidl_adapter.parser`, which reads the content of definitions.

`names.py` has valid names and errors, `types.py` types of fields, `values.py` constants and default values,
`specification.py` the parts of a definition, `comments.py` comments, `parser.py` whole definitions.

Invariants:

- Classes, attributes and errors are ROS 2's. The grammar is ROS 2's too, so it refuses some definitions that
  busd itself accepts (`bus.types.idl`), such as a field with the type `std_msgs/msg/Header`.
- It reads texts and files only. It does not look whether a type exists.

Read first: `parser.py`. Tests: `tests/unit/bus_ros/rosidl_adapter/`.
"""
