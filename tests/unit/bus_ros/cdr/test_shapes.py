"""The names and descriptions of a user's own types for ROS 2's tools."""

import math
from typing import Any

import msgspec
import pytest
from msgspec import Struct

import bus
from bus_ros.cdr import CdrError, codec_of
from bus_ros.cdr.definition import write
from bus_ros.cdr.shapes import describe
from ownclasses import WHEEL, Nut, Wheel, größe_x
from payloads import payload
from rows import for_each


def described(types: dict[str, list[tuple[str, Any]]]) -> str:
    """The definition of the first of these types."""
    fields = {
        name: {"fields": [{"name": field, "type": node} for field, node in listed], "array": True}
        for name, listed in types.items()
    }
    return write(describe({"root": next(iter(types)), "types": fields}).schema)


def test_a_class_is_described_as_ros_can() -> None:
    codec = codec_of(bus.MessageSchema.of(Wheel))
    assert (codec.type_name, codec.definition) == ("local/msg/Wheel", WHEEL)
    assert codec.as_json == ("local/msg/Wheel.extra", "local/msg/Wheel.pair", "local/msg/Wheel.either")


def test_its_messages_come_back_as_they_were() -> None:
    schema = bus.MessageSchema.of(Wheel)
    codec = codec_of(schema)
    for seed in range(50):
        sent = payload(schema.description, seed)
        back = codec.decode(b"".join(codec.encode(sent)))
        assert msgspec.msgpack.decode(back) == msgspec.msgpack.decode(sent)
        msgspec.msgpack.decode(back, type=Wheel)


@for_each(
    ("name", "ros_name"),
    [
        ("std_msgs/msg/String", "std_msgs/msg/String"),
        ("std_srvs/srv/SetBool_Event", "std_srvs/srv/SetBool_Event"),
        ("demo/msg/my_type", "demo/msg/MyType"),
        ("Demo/msg/wheelInfo", "demo/msg/WheelInfo"),
        ("my__pkg_/msg/A_B", "my_pkg/msg/AB"),
        ("demo/msg/Größe", "demo/msg/Groe"),
        ("demo/msg/速度", "demo/msg/Type"),
    ],
)
def test_names_of_types_are_made_fit(name: str, ros_name: str) -> None:
    assert describe({"root": name, "types": {name: {"fields": []}}}).schema["root"] == ros_name


@for_each(
    ("name", "ros_name"),
    [
        ("frame_id", "frame_id"),
        ("cameraInfo", "camera_info"),
        ("_x", "x"),
        ("x_", "x"),
        ("X", "x"),
        ("a__b", "a_b"),
        ("größe", "groe"),
        ("速度", "field"),
        ("_1", "field_1"),
    ],
)
def test_names_of_fields_are_made_fit(name: str, ros_name: str) -> None:
    assert described({"a/msg/A": [(name, "int8")]}) == f"int8 {ros_name}\n"


def test_names_that_become_the_same_are_numbered_and_right_ones_stay() -> None:
    types = {"a/msg/Root": [("X", "a/msg/b"), ("x", "a/msg/B"), ("_x", "a/msg/B_")], "a/msg/b": []}
    text = described(types | {"a/msg/B": [("is_right", "bool")], "a/msg/B_": []})
    assert text.startswith("a/B2 x2\na/B x\na/B3 x3\n")
    assert "MSG: a/B\nbool is_right\n" in text


def test_a_name_of_an_entry_makes_way_for_a_type_of_that_name() -> None:
    types = {"a/msg/A": [("x", ["dict", "string", "int8"]), ("y", "a/msg/AXEntry")], "a/msg/AXEntry": []}
    assert described(types).startswith("a/AXEntry2[] x\na/AXEntry y\n")


@for_each(
    ("node", "ros"),
    [
        ("int", "int64"),
        ("char", "uint8"),
        ("byte", "byte"),
        ("byte[]", "byte[]"),
        (["bytes", 4, 4], "uint8[4]"),
        (["bytes", 0, 4, "byte"], "byte[<=4]"),
        (["bytes", 2, 4], "uint8[<=4]"),
        (["bytes", 2, None], "uint8[]"),
        (["string", 10], "string<=10"),
        (["list", ["string", 10], 0, 3], "string<=10[<=3]"),
        (["list", "int8", 2, None], "int8[]"),
        (["list", "int8", 0, 0], "int8[]"),
        (["literal", 1, 2], "int64"),
        (["literal", "a"], "string"),
        (["literal", "a", 1], "busd/Json"),
        (["literal", None], "busd/Json"),
        (["tuple", "float64", "float64"], "float64[2]"),
        (["tuple", "uint8"], "uint8[1]"),
        (["list", ["tuple", "int8", "int8"]], "a/AXItem[]"),
        (["tuple", "int8", "string"], "busd/Json"),
        (["tuple"], "busd/Json"),
        (["union", "int8", "none"], "int8[<=1]"),
        (["union", "none", "unset"], "busd/Json"),
        (["union", "int8", "none", "unset"], "busd/Json"),
        (["union", "int8", "string"], "busd/Json"),
        (["list", "any"], "busd/Json[]"),
        ("none", "busd/Json"),
        (["list", ["list", "int8"]], "a/AXItem[]"),
        (["union", ["list", "int8"], "none"], "a/AXItem[<=1]"),
        (["dict", "string", ["list", "int8"]], "a/AXEntry[]"),
    ],
)
def test_each_type_has_one_in_ros(node: Any, ros: str) -> None:
    assert described({"a/msg/A": [("x", node)]}).splitlines()[0] == f"{ros} x"


def test_classes_that_need_nothing_of_that_are_known_to_ros_by_their_hash() -> None:
    class Pair(Struct, array_like=True):
        __type_name__ = "demo/msg/Pair"
        values: list[float]
        name: str

    schema = bus.MessageSchema.of(Pair)
    assert codec_of(schema).type_hash == schema.type_hash
    assert schema.type_hash.startswith("RIHS01_")
    for cls in (Nut, größe_x, Wheel):
        schema = bus.MessageSchema.of(cls)
        assert codec_of(schema).type_hash.startswith("RIHS01_")
        assert schema.type_hash.startswith("BUS01_")


def test_what_json_cannot_say_is_refused_where_it_could_not_be_read_back() -> None:
    class Corner(Struct):
        place: tuple[float, float, float]
        named: tuple[str, float | None]
        other: Any = None

    codec = codec_of(bus.MessageSchema.of(Corner))
    assert codec.as_json == ("local/msg/Corner.named", "local/msg/Corner.other")
    (sent,) = codec.encode(msgspec.msgpack.encode(Corner((math.nan, math.inf, 1.0), ("a", None), math.nan)))
    back = msgspec.msgpack.decode(codec.decode(sent), type=Corner)
    assert math.isnan(back.place[0]) and back.place[1:] == (math.inf, 1.0)
    assert (back.named, back.other) == (("a", None), None)

    class Named(Struct):
        named: tuple[str, float]

    with pytest.raises(CdrError, match="no payload of local/msg/Named"):
        codec_of(bus.MessageSchema.of(Named)).encode(msgspec.msgpack.encode(Named(("a", math.nan))))
