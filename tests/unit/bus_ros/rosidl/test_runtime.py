"""Messages as plain values and back."""

from array import array
from typing import Any

import pytest

from bus_ros.rosidl import definition, message_class, runtime
from rows import for_each


def cls(name: str) -> Any:
    return message_class(name)


def test_plain_values() -> None:
    joints = cls("sensor_msgs/msg/JointState")(name=["a", "b"], position=[1.0, 2.0])
    plain = runtime.message_to_ordereddict(joints)
    assert list(plain) == ["header", "name", "position", "velocity", "effort"]
    assert plain["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert (plain["name"], plain["position"]) == (["a", "b"], [1.0, 2.0])
    cut = runtime.message_to_ordereddict(joints, truncate_length=1)
    assert cut["name"] == ["a", "..."] and cut["position"] == [1.0, "..."]
    short = runtime.message_to_ordereddict(joints, no_arr=True, no_str=True)
    assert short["position"] == "<sequence type: double, length: 2>"
    assert short["header"]["frame_id"] == "<string length: <0>>"
    texts = runtime.message_to_ordereddict(joints, no_str=True)
    assert texts["name"] == ["<string length: <1>>", "<string length: <1>>"]
    assert short["name"] == "<sequence type: string, length: 2>"
    path = runtime.message_to_ordereddict(cls("nav_msgs/msg/Path")(), no_arr=True)
    assert path["poses"] == "<sequence type: geometry_msgs/msg/PoseStamped, length: 0>"
    bounded = runtime.message_to_ordereddict(cls("shape_msgs/msg/SolidPrimitive")(), no_arr=True)
    assert bounded["dimensions"] == "<sequence type: double[3], length: 0>"
    info = runtime.message_to_ordereddict(cls("sensor_msgs/msg/CameraInfo")(), no_arr=True)
    assert info["k"] == "<array type: double[9]>"
    assert runtime.message_to_ordereddict(b"\xce") == {"bytes": b"\xce"}


def test_types_of_fields() -> None:
    types = runtime.get_message_slot_types(cls("std_msgs/msg/Header")())
    assert list(types) == ["stamp", "frame_id"]
    assert types["frame_id"] == definition.UnboundedString()


def test_texts() -> None:
    message = cls("geometry_msgs/msg/PointStamped")()
    message.header.frame_id = "mäp"
    message.point.x = 1.5
    assert runtime.message_to_yaml(message) == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: mäp\n"
        "point:\n  x: 1.5\n  y: 0.0\n  z: 0.0\n"
    )
    assert runtime.message_to_csv(message) == "0,0,mäp,1.5,0.0,0.0"
    assert runtime.message_to_csv(b"a") == "b'a'"


def test_fields_from_plain_values() -> None:
    marker = cls("visualization_msgs/msg/Marker")()
    rest = runtime.set_message_fields(
        marker,
        {
            "ns": "a",
            "id": 3,
            "scale": {"x": 2},
            "points": [{"x": 1}, cls("geometry_msgs/msg/Point")(y=1.0)],
            "frame_locked": True,
            "color": cls("std_msgs/msg/ColorRGBA")(r=1.0),
        },
    )
    assert rest == []
    assert (marker.ns, marker.id, marker.scale.x, marker.color.r) == ("a", 3, 2.0, 1.0)
    assert [(point.x, point.y) for point in marker.points] == [(1.0, 0.0), (0.0, 1.0)]
    arrays = cls("std_msgs/msg/Float64MultiArray")()
    runtime.set_message_fields(arrays, {"data": [1, 2]})
    assert arrays.data == array("d", [1.0, 2.0])
    info = cls("sensor_msgs/msg/CameraInfo")()
    runtime.set_message_fields(info, {"k": range(9)})
    assert info.k.tolist() == [float(i) for i in range(9)]


def test_stamps_are_filled_in_later() -> None:
    stamped = cls("geometry_msgs/msg/PointStamped")()
    stamps = runtime.set_message_fields(stamped, {"header": "auto"}, expand_header_auto=True)
    stamps += runtime.set_message_fields(stamped.header, {"stamp": "now"}, expand_time_now=True)
    now = cls("builtin_interfaces/msg/Time")(sec=5)
    assert len(stamps) == 2
    for stamp in stamps:
        stamped.header.stamp = cls("builtin_interfaces/msg/Time")()
        stamp(now)
        assert stamped.header.stamp is now


@for_each(
    ("values", "kind", "text"),
    [
        ("x", TypeError, "Value 'x' is expected to be a dictionary but is a str"),
        ({"nothing": 1}, AttributeError, "no attribute 'nothing'"),
        ({"point": 5}, TypeError, "Value '5' is expected to be a dictionary but is a int"),
        ({"point": {"x": "abc"}}, ValueError, "could not convert string to float"),
    ],
)
def test_wrong_values(values: Any, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind, match=text):
        runtime.set_message_fields(cls("geometry_msgs/msg/PointStamped")(), values)


def test_a_text_is_no_truth_value() -> None:
    with pytest.raises(AssertionError, match="must be of type 'bool'"):
        runtime.set_message_fields(cls("std_msgs/msg/Bool")(), {"data": "false"})
