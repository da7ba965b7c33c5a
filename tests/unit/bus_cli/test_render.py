"""Messages as YAML, CSV and JSON values, in the form of `ros2 topic echo`."""

import math
from typing import Any

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from bus.base.printable import printable
from bus.msg.geometry_msgs import Point, Point32, Polygon, PoseWithCovariance, Twist
from bus.msg.sensor_msgs import Image, JointState
from bus.msg.std_msgs import Byte, ByteMultiArray, Empty, Header, String, UInt8MultiArray
from bus.types.schema import build, describe
from bus.types.support import type_support
from bus_cli.render import Budget, TooManyValuesError, View, to_csv, to_text, to_yaml
from rows import for_each


class Part(msgspec.Struct):
    size: int


class Own(msgspec.Struct):
    """One field of each kind that ROS does not have."""

    part: Part | None = None
    anything: Any = None
    table: dict[str, Part] = {}
    pair: tuple[int, str] = (1, "x")
    either: int | str = 0
    left_out: int | msgspec.UnsetType = msgspec.UNSET


def plain(message: msgspec.Struct, **options: Any) -> Any:
    schema = type_support(type(message)).schema
    return View(**options).plain(schema, schema["root"], message)


def test_a_budget_bounds_what_is_shown() -> None:
    budget = Budget(5)
    message = JointState(position=[0.0] * 1000)
    with pytest.raises(TooManyValuesError):
        plain(message, budget=budget)
    budget.left = budget.most
    assert plain(String(data="a"), budget=budget) == {"data": "a"}
    budget.left = budget.most
    for left in (True, True, False):
        if left:
            plain(String(data="a"), budget=budget)
        else:
            with pytest.raises(TooManyValuesError):
                plain(String(data="a"), budget=budget)


def test_text_with_a_colon_is_quoted() -> None:
    assert to_yaml(plain(String(data="Hello World: 1"))) == "data: 'Hello World: 1'\n"


def test_plain_text_is_not_quoted() -> None:
    assert to_yaml(plain(String(data="Hello"))) == "data: Hello\n"


@for_each(
    ("text", "line"),
    [
        ("", "data: ''\n"),
        ("1", "data: '1'\n"),
        ("yes", "data: 'yes'\n"),
        ("grün ☃", "data: grün ☃\n"),
        ("a\nb", "data: 'a\n\n  b'\n"),
        ("tab\t", 'data: "tab\\t"\n'),
        ("x" * 128, f"data: {'x' * 128}\n"),
        ("word " * 100, f"data: '{'word ' * 100}'\n"),
    ],
)
def test_text_as_pyyaml_writes_it(text: str, line: str) -> None:
    assert to_yaml(plain(String(data=text))) == line


def test_nested_messages_are_indented_and_sequences_are_not() -> None:
    message = JointState(name=["a", "b"], position=[1.0, 2.5])
    assert to_yaml(plain(message)) == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        "name:\n- a\n- b\nposition:\n- 1.0\n- 2.5\nvelocity: []\neffort: []\n"
    )


def test_a_sequence_of_messages() -> None:
    message = Polygon(points=[Point32(x=1.0), Point32(y=2.0)])
    assert to_yaml(plain(message)) == "points:\n- x: 1.0\n  y: 0.0\n  z: 0.0\n- x: 0.0\n  y: 2.0\n  z: 0.0\n"


def test_flow_style_keeps_the_outer_mappings_in_blocks() -> None:
    message = Polygon(points=[Point32(x=1.0)])
    assert to_yaml(plain(message), flow_style=True) == "points: [{x: 1.0, y: 0.0, z: 0.0}]\n"
    assert to_yaml(plain(Twist()), flow_style=True) == (
        "linear:\n  x: 0.0\n  y: 0.0\n  z: 0.0\nangular:\n  x: 0.0\n  y: 0.0\n  z: 0.0\n"
    )


def test_an_empty_message() -> None:
    assert to_yaml(plain(Empty())) == "{}\n"


def test_numbers_that_are_none() -> None:
    text = to_yaml(plain(Point(x=math.nan, y=math.inf, z=-math.inf)))
    assert text == "x: .nan\ny: .inf\nz: -.inf\n"


def test_octets_of_an_array_are_numbers() -> None:
    assert to_yaml(plain(UInt8MultiArray(data=b"\x00\xff"))).endswith("data:\n- 0\n- 255\n")


def test_single_octets_are_characters_as_in_ros2_and_numbers_in_json() -> None:
    assert plain(Byte(data=b"A")) == {"data": "A"}
    assert plain(Byte(data=b"A"), octets=True) == {"data": 65}
    assert plain(ByteMultiArray(data=b"AB"))["data"] == ["A", "B"]
    assert plain(ByteMultiArray(data=b"AB"), octets=True)["data"] == [65, 66]


def test_truncation_of_texts_and_sequences() -> None:
    assert plain(String(data="Hello World"), truncate_length=5) == {"data": "Hello..."}
    assert plain(String(data="Hello"), truncate_length=5) == {"data": "Hello"}
    assert plain(JointState(position=[1.0, 2.0, 3.0]), truncate_length=2)["position"] == [1.0, 2.0, "..."]
    assert plain(Image(data=bytes(1000)), truncate_length=0)["data"] == ["..."]


def test_truncation_reaches_the_items() -> None:
    assert plain(JointState(name=["abcdef"]), truncate_length=3)["name"] == ["abc..."]


def test_no_arr_says_the_type() -> None:
    shown = plain(JointState(position=[1.0], name=["a", "b"]), no_arr=True)
    assert shown["position"] == "<sequence type: double, length: 1>"
    assert shown["name"] == "<sequence type: string, length: 2>"
    assert plain(PoseWithCovariance(), no_arr=True)["covariance"] == "<array type: double[36]>"
    assert plain(Polygon(), no_arr=True)["points"] == "<sequence type: geometry_msgs/msg/Point32, length: 0>"
    assert plain(Image(data=b"123"), no_arr=True)["data"] == "<sequence type: uint8, length: 3>"


def test_no_str_says_the_length() -> None:
    assert to_yaml(plain(String(data="Hello World: 1"), no_str=True)) == "data: '<string length: <14>>'\n"


def test_types_that_ros_does_not_have() -> None:
    message = Own(part=Part(3), anything=[1, {"a": b"\x01"}], table={"k": Part(4)}, either="x")
    assert plain(message) == {
        "part": {"size": 3},
        "anything": [1, {"a": [1]}],
        "table": {"k": {"size": 4}},
        "pair": [1, "x"],
        "either": "x",
    }


def test_a_class_made_from_a_schema_looks_like_the_one_it_describes() -> None:
    message = Own(part=Part(3), anything="x", table={"k": Part(4)})
    foreign = build(describe(Own))
    copy = msgspec.msgpack.decode(msgspec.msgpack.encode(message), type=foreign)
    assert plain(copy) == plain(message)


@for_each(
    ("message", "line"),
    [
        (String(data="Hello World: 53"), "Hello World: 53"),
        (Header(frame_id="map"), "0,0,map"),
        (JointState(name=["a", "b"], position=[1.0]), "0,0,,a,b,1.0"),
        (Empty(), ""),
    ],
)
def test_csv_has_the_leaves_in_order(message: msgspec.Struct, line: str) -> None:
    assert to_csv(plain(message)) == line


def test_csv_is_truncated_too() -> None:
    assert to_csv(plain(JointState(position=[1.0, 2.0]), truncate_length=1)) == "0,0,,1.0,..."


def test_a_scalar_by_itself_is_not_yaml() -> None:
    assert to_text("Hello World: 49") == "Hello World: 49\n"
    assert to_text(1.5) == "1.5\n"
    assert to_text([1.5]) == "- 1.5\n"


def test_control_characters_of_others() -> None:
    text = "a\x1b[2J\x9b\u202eb\r\n\tc"
    assert to_text(text) == "a\\x1b[2J\\x9b\\u202eb\\r\n\tc\n"
    assert to_csv({"a": text, "b": [1, text]}) == ",".join(
        ["a\\x1b[2J\\x9b\\u202eb\\r\\n\tc", "1", "a\\x1b[2J\\x9b\\u202eb\\r\\n\tc"]
    )


texts = st.text(st.characters(codec="utf-8") | st.sampled_from("\x1b\x85\x9b\u202e\u2028\u2066\r\n\t\x7f"))
messages = st.builds(
    JointState,
    name=st.lists(texts),
    position=st.lists(st.floats(allow_nan=False)),
)


@given(messages)
def test_yaml_reads_back(message: JointState) -> None:
    text = to_yaml(plain(message))
    assert yaml.safe_load(text) == plain(message)
    assert printable(text) == text


@given(messages, st.integers(0, 5))
def test_nothing_is_longer_than_the_truncation(message: JointState, length: int) -> None:
    shown = plain(message, truncate_length=length)
    assert len(shown["position"]) <= length + 1
    assert all(len(name) <= length + 3 for name in shown["name"])
