"""The ready-made message classes: complete, named and printed as in ROS 2, and equal at both ends."""

import difflib
from importlib import import_module
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import messageclasses
from bus.msg import PACKAGES, Message, float64, uint8
from bus.msg.builtin_interfaces import Duration, Time
from bus.msg.geometry_msgs import Quaternion, Twist, Vector3
from bus.msg.rcl_interfaces import Log
from bus.msg.sensor_msgs import Image, Imu, JoyFeedback, NavSatFix, NavSatStatus, PointField, Range
from bus.msg.std_msgs import Byte, ByteMultiArray, Header, String, UInt8MultiArray
from bus.types.schema import Node, Schema, build, describe, type_name
from bus.types.support import find_type, type_hash, type_support
from effort import examples

CLASSES: list[type[Message]] = [
    getattr(module, name)
    for module in (import_module(f"bus.msg.{package}") for package in PACKAGES)
    for name in module.__all__
]

INTEGERS = {f"{sign}int{bits}": (sign, bits) for sign in ("", "u") for bits in (8, 16, 32, 64)}


def values(schema: Schema, node: Node) -> st.SearchStrategy[Any]:
    """Values of a type in the schema of a ROS message, in the Python types that a decoder makes."""
    match node:
        case "bool":
            return st.booleans()
        case "float32" | "float64":
            return st.floats(allow_nan=False)
        case "string":
            return st.text(st.characters(codec="utf-8"), max_size=8)
        case "uint8[]" | "byte[]":
            return st.binary(max_size=8)
        case "byte":
            return st.binary(min_size=1, max_size=1)
        case "char":
            return st.integers(0, 255)
        case str() if node in INTEGERS:
            sign, bits = INTEGERS[node]
            return (
                st.integers(0, 2**bits - 1) if sign else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
            )
        case str():
            return messages(schema, node)
        case ["list", item, length, same] if length == same:
            # One value, repeated. 36 separate draws would slow Hypothesis down and find nothing more.
            return values(schema, item).map(lambda value: [value] * length)
        case ["list", item]:
            return st.lists(values(schema, item), max_size=3)
    raise AssertionError(f"no ROS type: {node}")


def messages(schema: Schema, name: str) -> st.SearchStrategy[Any]:
    cls = find_type(name)
    assert cls is not None
    fields = {field["name"]: values(schema, field["type"]) for field in schema["types"][name]["fields"]}
    return st.builds(cls, **fields)


def test_modules_are_what_the_definitions_say() -> None:
    for path, text in messageclasses.modules().items():
        changed = list(
            difflib.unified_diff(path.read_text().splitlines(), text.splitlines(), lineterm="", n=0)
        )
        assert not changed, f"{path} is of another time; run: make messages\n" + "\n".join(changed)


def test_every_class_is_named_and_found_as_in_ros() -> None:
    assert len(CLASSES) == 98
    for cls in CLASSES:
        package = cls.__module__.removeprefix("bus.msg.")
        assert type_name(cls) == f"{package}/msg/{cls.__name__}"
        assert find_type(f"{package}/msg/{cls.__name__}") is find_type(f"{package}/{cls.__name__}") is cls


def test_fields_are_given_by_name() -> None:
    assert Imu() == Imu()
    with pytest.raises(TypeError):
        String("hi")  # type: ignore[call-arg, misc]


def test_every_default_is_valid_and_comes_back_equal() -> None:
    for cls in CLASSES:
        support = type_support(cls)
        message = cls()
        assert support.is_valid(message)
        assert support.explain(message) is None
        decoded = support.decode(support.encode(message))
        assert decoded == message and type(decoded) is cls


def test_defaults_are_not_shared() -> None:
    for cls in CLASSES:
        first, second = cls(), cls()
        for name in cls.__struct_fields__:
            value = getattr(first, name)
            if isinstance(value, list | Message):
                assert value is not getattr(second, name), f"{type_name(cls)}.{name}"


def test_every_class_is_described_so_that_others_can_read_it() -> None:
    for cls in CLASSES:
        schema = msgspec.msgpack.decode(msgspec.msgpack.encode(describe(cls)))
        foreign = build(schema)
        support = type_support(foreign)
        data = type_support(cls).encode(cls())
        message = support.decode(data)
        assert describe(foreign) == schema == describe(cls)
        assert support.name == type_name(cls)
        assert support.hash == type_hash(cls)
        assert support.encode(message) == support.encode(foreign()) == data
        assert repr(message) == repr(cls())


def test_hashes_differ() -> None:
    assert len({type_hash(cls) for cls in CLASSES}) == len(CLASSES)


@settings(max_examples=examples(200))
@given(data=st.data())
def test_any_message_comes_back_equal(data: st.DataObject) -> None:
    support = type_support(data.draw(st.sampled_from(CLASSES)))
    message = data.draw(messages(support.schema, support.name))
    assert support.is_valid(message)
    encoded = support.encode(message)
    assert support.decode(encoded) == message
    foreign = type_support(build(support.schema))
    assert foreign.encode(foreign.decode(encoded)) == encoded


def test_defaults_of_ros() -> None:
    assert Quaternion() == Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    assert NavSatStatus().status == NavSatStatus.STATUS_UNKNOWN == -2
    assert NavSatFix().status.status == -2
    assert Imu().orientation_covariance == [0.0] * 9
    assert Byte().data == b"\x00"
    assert Image().data == b""
    assert Header() == Header(stamp=Time(sec=0, nanosec=0), frame_id="")


def test_constants_belong_to_the_class() -> None:
    assert (Range.ULTRASOUND, Range.INFRARED) == (0, 1)
    assert (PointField.INT8, PointField.FLOAT32, PointField.FLOAT64) == (1, 7, 8)
    assert JoyFeedback.TYPE_BUZZER == 2
    assert (Log.DEBUG, Log.INFO, Log.WARN, Log.ERROR, Log.FATAL) == (10, 20, 30, 40, 50)
    assert "INFO" not in Log.__struct_fields__


def test_prints_as_rclpy_does() -> None:
    assert repr(String(data="hi")) == "std_msgs.msg.String(data='hi')"
    assert repr(Twist(linear=Vector3(x=0.5))) == (
        "geometry_msgs.msg.Twist(linear=geometry_msgs.msg.Vector3(x=0.5, y=0.0, z=0.0), "
        "angular=geometry_msgs.msg.Vector3(x=0.0, y=0.0, z=0.0))"
    )
    assert repr(Duration(sec=-1)) == "builtin_interfaces.msg.Duration(sec=-1, nanosec=0)"
    assert repr(Byte(data=b"\x07")) == r"std_msgs.msg.Byte(data=b'\x07')"
    assert "data=[1, 255]" in repr(UInt8MultiArray(data=b"\x01\xff"))
    assert "data=[1, 255]" in repr(UInt8MultiArray(data=memoryview(b"\x01\xff")))  # type: ignore[arg-type]
    assert r"data=[b'\x01', b'\xff']" in repr(ByteMultiArray(data=b"\x01\xff"))


def test_an_own_message_is_local_unless_it_says_otherwise() -> None:
    class Wheel(Message, kw_only=True):
        index: uint8 = 0
        speed: float64 = 0.0

    class Named(Wheel, kw_only=True):
        __type_name__ = "demo/msg/Named"

    class Derived(Named, kw_only=True):
        pass

    assert type_name(Wheel) == "local/msg/Wheel"
    assert repr(Wheel(index=3)) == "local.msg.Wheel(index=3, speed=0.0)"
    assert type_name(Named) == "demo/msg/Named"
    assert repr(Named()) == "demo.msg.Named(index=0, speed=0.0)"
    assert type_name(Derived) == "local/msg/Derived"
    assert type_hash(Wheel).startswith("RIHS01_")
