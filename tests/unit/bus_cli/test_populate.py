"""Messages from YAML values, and YAML documents from a stream."""

import time
from typing import Any, Literal

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.msg.builtin_interfaces import Time
from bus.msg.geometry_msgs import Point, PoseArray, PoseStamped, PoseWithCovariance, Twist
from bus.msg.sensor_msgs import JointState
from bus.msg.std_msgs import (
    Bool,
    Byte,
    ByteMultiArray,
    Char,
    Float64,
    Header,
    Int8,
    Int32,
    String,
    UInt8MultiArray,
)
from bus.types.schema import build, describe
from bus.types.support import type_support
from bus_cli.documents import load, split
from bus_cli.output import CommandError
from bus_cli.populate import Prototype
from bus_cli.render import View, to_yaml
from rows import for_each


class Wheel(msgspec.Struct):
    index: int
    speed: float = 0.0


class Own(msgspec.Struct):
    name: str
    wheels: list[Wheel] = []
    table: dict[str, Wheel] = {}
    pair: tuple[int, str] = (1, "x")
    mode: Literal["slow", "fast"] = "slow"
    maybe: float | None = None


def make(cls: type[msgspec.Struct], text: str) -> Any:
    return Prototype(cls, load(text)).message


@for_each(
    ("cls", "text", "message"),
    [
        (String, "data: hi", String(data="hi")),
        (String, "{}", String()),
        (String, "data: 5", String(data="5")),
        (String, "data: 2024-01-01", String(data="2024-01-01")),
        (String, "{data: 'a: b'}", String(data="a: b")),
        (Int32, "data: '7'", Int32(data=7)),
        (Int32, "data: 7.0", Int32(data=7)),
        (Float64, "data: 1", Float64(data=1.0)),
        (Float64, "data: .inf", Float64(data=float("inf"))),
        (Float64, "data: 1e3", Float64(data=1000.0)),
        (Bool, "data: yes", Bool(data=True)),
        (Bool, "data: 0", Bool(data=False)),
        (Char, "data: 65", Char(data=65)),
        (Byte, "data: 65", Byte(data=b"A")),
        (Byte, "data: A", Byte(data=b"A")),
        (ByteMultiArray, "data: [65, B]", ByteMultiArray(data=b"AB")),
        (UInt8MultiArray, "data: [1, 255]", UInt8MultiArray(data=b"\x01\xff")),
        (UInt8MultiArray, "data: !!binary AQI=", UInt8MultiArray(data=b"\x01\x02")),
        (JointState, "{name: [a, 1], position: [1, 2.5]}", JointState(name=["a", "1"], position=[1.0, 2.5])),
        (Twist, "{linear: {x: 2.0}}", Twist(linear=Twist().linear.__class__(x=2.0))),
    ],
)
def test_what_values_mean(cls: type[msgspec.Struct], text: str, message: msgspec.Struct) -> None:
    assert make(cls, text) == message


def test_messages_in_sequences() -> None:
    message = make(PoseArray, "{poses: [{position: {x: 1}}, {}]}")
    assert [pose.position for pose in message.poses] == [Point(x=1.0), Point()]
    assert message.poses[1].orientation.w == 1.0


@pytest.mark.parametrize("cls", [Own, build(describe(Own))])
def test_own_types_also_those_made_from_a_schema(cls: type[msgspec.Struct]) -> None:
    text = "{name: hi, wheels: [{index: 3}], table: {k: {index: 4}}, pair: [5, y], mode: fast, maybe: 1}"
    message = make(cls, text)
    data = type_support(cls).encode(message)
    assert type_support(Own).decode(data) == Own("hi", [Wheel(3)], {"k": Wheel(4)}, (5, "y"), "fast", 1.0)


@for_each("values", ["hi", "5", "[data]", "", "null", "'data: hi'"])
def test_values_must_be_a_dictionary(values: str) -> None:
    with pytest.raises(CommandError) as caught:
        make(String, values)
    assert str(caught.value) == "The passed value needs to be a dictionary in YAML format"


@for_each("text", ["{", "data: [", "\t- x", "a: b: c", "[" * 5000, "d: 2024-99-99", "!!python/none x"])
def test_what_is_no_yaml(text: str) -> None:
    with pytest.raises(CommandError, match="The passed value needs to be a dictionary in YAML format"):
        load(text)


@for_each(
    ("cls", "text", "error"),
    [
        (String, "dat: hi", "'String' object has no attribute 'dat'; did you mean 'data'?"),
        (String, "{data:hi}", "'String' object has no attribute 'data:hi'"),
        (PoseStamped, "{pose: {pos: 1}}", "'Pose' object has no attribute 'pos'"),
        (PoseStamped, "{pose: 1}", "Value '1' is expected to be a dictionary but is a int"),
        (Int32, "data: x", "'data' takes int32, not 'x'"),
        (Int32, "data: 1.5", "1.5 is not a whole number"),
        (Int32, "data: .nan", "cannot convert float NaN to integer"),
        (Float64, "data: x", "'data' takes float64, not 'x'"),
        (Int8, "data: 200", "std_msgs/msg/Int8: Expected `int` <= 127 - at `$.data`"),
        (String, "data: ", "std_msgs/msg/String: Expected `str`, got `None` - at `$.data`"),
        (String, "data: [1]", "std_msgs/msg/String: Expected `str`, got `array` - at `$.data`"),
        (Bool, "data: 'no'", "std_msgs/msg/Bool: Expected `bool`, got `str` - at `$.data`"),
        (UInt8MultiArray, "data: [256]", "bytes must be in range(0, 256)"),
        (Own, "{}", "Missing required argument 'name'"),
        (Own, "{name: x, mode: quick}", "local/msg/Own: Invalid enum value 'quick' - at `$.mode`"),
        (Own, "{name: x, wheels: [{}]}", "Missing required argument 'index'"),
        (String, "{1: 2}", "'String' object has no attribute '1'"),
    ],
)
def test_what_does_not_fit(cls: type[msgspec.Struct], text: str, error: str) -> None:
    with pytest.raises(CommandError) as caught:
        make(cls, text)
    assert str(caught.value) == f"Failed to populate field: {error}"


def test_a_fixed_array_of_the_wrong_length() -> None:
    with pytest.raises(CommandError, match=r"Failed to populate field: .*covariance"):
        make(PoseWithCovariance, "covariance: [1, 2]")


@for_each(
    ("cls", "text", "stamp"),
    [
        (PoseStamped, "header: auto", lambda m: m.header.stamp),
        (PoseStamped, "header: {stamp: now, frame_id: map}", lambda m: m.header.stamp),
        (Header, "stamp: now", lambda m: m.stamp),
        (build(describe(PoseStamped)), "header: auto", lambda m: m.header.stamp),
    ],
)
def test_now_and_auto_are_the_time_of_each_publication(cls: Any, text: str, stamp: Any) -> None:
    prototype = Prototype(cls, load(text))
    seen = []
    for _ in range(2):
        before = time.time_ns()
        prototype.stamp()
        found = stamp(prototype.message)
        seen.append(found.sec * 10**9 + found.nanosec)
        assert before <= seen[-1] <= time.time_ns()
    assert seen[0] < seen[1]


def test_a_text_field_may_say_auto() -> None:
    prototype = Prototype(String, {"data": "now"})
    prototype.stamp()
    assert prototype.message == String(data="now")


def test_a_time_may_be_given() -> None:
    prototype = Prototype(Header, load("stamp: {sec: 5, nanosec: 6}"))
    prototype.stamp()
    assert prototype.message.stamp == Time(sec=5, nanosec=6)


def test_documents_as_echo_prints_them() -> None:
    lines = "data: a\n---\ndata: b\n---\n".splitlines(keepends=True)
    assert [load(document) for document in split(lines)] == [{"data": "a"}, {"data": "b"}]


def test_documents_as_echo_prints_them_in_json() -> None:
    lines = '\n{"data":"a"}\n \n\n{"data":"---"}\n'.splitlines(keepends=True)
    assert [load(document) for document in split(lines)] == [{"data": "a"}, {"data": "---"}]


def test_the_last_document_needs_no_end_and_empty_ones_are_none() -> None:
    lines = ["---\n", "\n", "---\n", "{a: 1,\n", " b: 2}"]
    assert [load(document) for document in split(lines)] == [{"a": 1, "b": 2}]
    assert list(split(["\n", "---\n"])) == []


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Zl", "Zp"))), max_size=5))
def test_what_is_echoed_can_be_published(texts: list[str]) -> None:
    schema = type_support(JointState).schema
    message = JointState(name=texts, position=[1.5] * len(texts))
    text = to_yaml(View().plain(schema, schema["root"], message))
    (document,) = split(f"{text}---\n".splitlines(keepends=True))
    assert make(JointState, document) == message
