"""Definitions in the form of ROS 2's bag files."""

import pytest

from bus.errors import ConfigurationError
from bus.types.classes import message_class
from bus.types.support import type_hash
from bus_ros.cdr import schema_of_definition
from rows import for_each

LINE = "=" * 80

# As `ros2 bag record` writes it: the text of the files.
POSE_STAMPED = f"""\
# A Pose with reference coordinate frame and timestamp

std_msgs/Header header
Pose pose

{LINE}
MSG: geometry_msgs/Point
# This contains the position of a point in free space
float64 x
float64 y
float64 z

{LINE}
MSG: geometry_msgs/Pose
# A representation of pose in free space, composed of position and orientation.

Point position
Quaternion orientation

{LINE}
MSG: geometry_msgs/Quaternion
# This represents an orientation in free space in quaternion form.

float64 x 0
float64 y 0
float64 z 0
float64 w 1

{LINE}
MSG: std_msgs/Header
# Standard metadata for higher-level stamped data types.
builtin_interfaces/Time stamp

# Transform frame with which this data is associated.
string frame_id
{LINE}
MSG: builtin_interfaces/Time
uint32 NEVER=0
int32 sec
uint32 nanosec
"""


@for_each("ends", ("\n", "\r\n"))
def test_definitions_of_ros_have_the_hash_that_they_have_there(ends: str) -> None:
    name = "geometry_msgs/msg/PoseStamped"
    schema = schema_of_definition(name, POSE_STAMPED.replace("\n", ends))
    assert (schema.type_name, schema.type_hash) == (name, type_hash(message_class(name)))
    assert schema.to_class() is message_class(name)


@for_each(
    ("definition", "type_"),
    [
        ("uint8[] x", "uint8[]"),
        ("uint8[3] x", ["bytes", 3, 3]),
        ("byte[<=3] x", ["bytes", 0, 3, "byte"]),
        ("char[] x", ["list", "char"]),
        ("string<=3[2] x", ["list", ["string", 3], 2, 2]),
        ("wstring<=3 x", ["wstring", 3]),
        ("wstring[] x", ["list", ["wstring"]]),
        ("float32[<=4] x [1.0, 2.0]", ["list", "float32", 0, 4]),
    ],
)
def test_each_type_is_read(definition: str, type_: object) -> None:
    schema = schema_of_definition("a/msg/A", definition)
    assert schema.description["types"]["a/msg/A"]["fields"][0]["type"] == type_


def test_a_message_without_fields_has_none_here() -> None:
    empty = type_hash(message_class("std_msgs/msg/Empty"))
    for text in ("", "# nothing\n", "uint8 structure_needs_at_least_one_member\n"):
        schema = schema_of_definition("std_msgs/msg/Empty", text)
        assert schema.type_hash == empty
        assert schema.description["types"]["std_msgs/msg/Empty"]["fields"] == []


def test_a_header_of_the_own_package() -> None:
    std = f"{LINE}\nMSG: std_msgs/Header\nint8 x\n"
    own = f"{LINE}\nMSG: a/Header\nHeader header\n"
    for parts, types in (
        (own + std, ["a/msg/A", "a/msg/Header", "std_msgs/msg/Header"]),
        (std, ["a/msg/A", "std_msgs/msg/Header"]),
    ):
        schema = schema_of_definition("a/msg/A", f"Header header\n{parts}")
        assert list(schema.description["types"]) == types


def test_parts_that_nobody_needs_are_left_out() -> None:
    schema = schema_of_definition("a/msg/A", f"int8 x\n{LINE}\nMSG: a/B\nnonsense\n")
    assert list(schema.description["types"]) == ["a/msg/A"]


@for_each(
    ("definition", "text"),
    [
        ("a/B x", "the definition of a/msg/A lacks a/msg/B"),
        ("int8", r"a/msg/A\.msg:1: 'int8' has no name after it"),
        (f"B x\n{LINE}\nMSG: a/B\nint9 y", r"a/msg/B\.msg:1: 'int9' is not a known type"),
        (f"B x\n{LINE}\nMSG: a/B\nA y", "contains itself"),
        ("int8[99999999] x", "a/msg/A: 'x' is too large"),
    ],
)
def test_what_is_wrong_is_said(definition: str, text: str) -> None:
    with pytest.raises(ConfigurationError, match=text):
        schema_of_definition("a/msg/A", definition)


@for_each("name", ("", "A", "a/msg/", "a/msg/A/b", "a msg A", "../msg/A"))
def test_a_name_of_a_type_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(ConfigurationError):
        schema_of_definition(name, "int8 x")
