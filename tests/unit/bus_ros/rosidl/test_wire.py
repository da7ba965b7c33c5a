"""Messages of rosidl's classes on the wire: the same bytes as from the native classes."""

import struct
from array import array
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus.errors import MessageTypeError
from bus.shm import has_core
from bus.types.classes import message_class as native_class
from bus.types.definitions import find_message, names
from bus.types.idl import INTEGERS, Type
from bus.types.large_fields import bytes_fields
from bus.types.support import type_hash, type_support, wrong_class
from bus_ros.rclpy.serialization import deserialize_message, serialize_message
from bus_ros.rosidl import RosMessage, message_class
from effort import examples
from rows import for_each

SHIPPED = ("builtin_interfaces", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "visualization_msgs")
MESSAGES = [name for package in SHIPPED for name in names("msg", package)]
PARTS = [f"{name}_{part}" for name in names("srv") for part in ("Request", "Response")]


def cls(name: str) -> Any:
    return message_class(name)


def support(name: str) -> Any:
    return type_support(cls(name))


def single(base: str) -> st.SearchStrategy[Any]:
    if "/" in base:
        return messages(base)
    if base == "byte":
        return st.binary(min_size=1, max_size=1)
    if base in INTEGERS:
        return st.integers(*INTEGERS[base])
    if base == "bool":
        return st.booleans()
    if base.startswith("float"):
        return st.floats(width=32 if base == "float32" else 64, allow_nan=False)
    return st.text(st.characters(codec="utf-8"), max_size=5)


def values(type_: Type) -> st.SearchStrategy[Any]:
    if not type_.array:
        return single(type_.base)
    least, most = (type_.size, type_.size) if type_.array == "fixed" else (0, min(type_.size or 3, 3))
    return st.lists(single(type_.base), min_size=least, max_size=most)


def messages(name: str) -> st.SearchStrategy[RosMessage]:
    fields = {field.name: values(field.type) for field in find_message(name).fields}
    return st.fixed_dictionaries(fields).map(lambda given: cls(name)(**given))


def test_a_default_message_is_the_native_one() -> None:
    for name in MESSAGES + PARTS:
        native: Any = native_class(name)
        ours, theirs = support(name), type_support(native)
        assert (ours.name, ours.hash, ours.schema) == (theirs.name, type_hash(native), theirs.schema)
        data = theirs.encode(native())
        assert ours.encode(cls(name)()) == data
        assert ours.plan is None or theirs.plan is not None
        assert ours.plan is None or ours.plan.encode(cls(name)()) == data
        assert ours.decode(data) == cls(name)()


@given(st.data())
@settings(max_examples=examples(150))
def test_any_message_gives_the_bytes_of_the_native_one(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from([name for name in MESSAGES if not name.startswith("visualization")]))
    message: Any = data.draw(messages(name))
    native = type_support(native_class(name))
    encoded = support(name).encode(message)
    plan = support(name).plan
    assert plan is None or plan.encode(message) == encoded
    assert native.encode(native.decode(encoded)) == encoded
    assert support(name).decode(encoded) == message
    assert support(name).is_valid(message) is True
    assert support(name).explain(message) is None
    assert deserialize_message(serialize_message(message), type(message)) == message


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
def test_by_plan_only_what_is_surely_right_is_encoded() -> None:
    point, pose = cls("geometry_msgs/msg/Point"), cls("geometry_msgs/msg/Pose")

    class Corner(point):  # type: ignore[valid-type]
        pass

    plan = support("geometry_msgs/msg/Pose").plan
    right = pose(position=point(x=1.0))
    assert plan.encode(right) == support("geometry_msgs/msg/Pose").encode(right)
    assert plan.encode(pose(position=Corner(x=1.0))) is None  # the other way encodes it
    assert plan.encode(Corner()) is None and plan.encode(native_class("geometry_msgs/msg/Pose")()) is None
    for name, value in (("UInt8", 256), ("Int8", True), ("Float64", "1"), ("String", "\ud800"), ("Bool", 1)):
        message = cls(f"std_msgs/msg/{name}")()
        message._data = value  # past the check of assigned values
        assert support(f"std_msgs/msg/{name}").plan.encode(message) is None


def test_any_buffer_is_read_and_what_is_no_message_refused() -> None:
    string = support("std_msgs/msg/String")
    data = string.encode(cls("std_msgs/msg/String")(data="hi"))
    for buffer in (bytearray(data), memoryview(data)):
        assert string.decode(buffer).data == "hi"
    for wrong in (b"", data[:-1], b"\xc1", b"\x91\x05"):
        with pytest.raises(msgspec.DecodeError):
            string.decode(wrong)
        with pytest.raises(ValueError, match="these bytes are no std_msgs/msg/String"):
            deserialize_message(wrong, cls("std_msgs/msg/String"))


def test_cdr_is_deserialized() -> None:
    string = cls("std_msgs/msg/String")
    assert deserialize_message(b"\0\1\0\0\3\0\0\0hi\0", string) == string(data="hi")
    assert deserialize_message(b"\0\0\0\0\0\0\0\3hi\0", string) == string(data="hi")  # big-endian
    assert deserialize_message(b"\0\1\0\0\0", cls("std_msgs/msg/Empty")) == cls("std_msgs/msg/Empty")()
    for wrong in (b"\0", b"\0\1\0\0\3\0\0\0h", b"\0\xff\0\0\3\0\0\0hi\0"):
        with pytest.raises(ValueError, match="no CDR message of std_msgs/msg/String"):
            deserialize_message(wrong, string)


def test_what_is_decoded_has_the_types_of_the_fields() -> None:
    image = cls("sensor_msgs/msg/Image")(data=b"abc")
    scan = cls("sensor_msgs/msg/LaserScan")(ranges=[1.0])
    path = cls("nav_msgs/msg/Path")(poses=[cls("geometry_msgs/msg/PoseStamped")()])
    octets = cls("std_msgs/msg/ByteMultiArray")(data=[b"a", b"b"])
    for message, field, kind in (
        (image, "data", array),
        (scan, "ranges", array),
        (path, "poses", list),
        (octets, "data", list),
    ):
        again = support(message.__type_name__).decode(support(message.__type_name__).encode(message))
        assert type(getattr(again, field)) is kind
        assert again == message
        assert type(again.header if hasattr(again, "header") else again.layout) is not None
    again.data.append(b"c")
    assert octets.data == [b"a", b"b"]


def test_a_float32_goes_as_it_is() -> None:
    data = support("std_msgs/msg/Float32").encode(cls("std_msgs/msg/Float32")(data=0.1))
    assert data == b"\x91\xcb" + struct.pack(">d", 0.1)


def broken(name: str, /, **fields: Any) -> Any:
    """A message whose lists became wrong after their assignment."""
    message = cls(name)()
    for field, value in fields.items():
        getattr(message, field).append(value)
    return message


@for_each(
    ("message", "text"),
    [
        (broken("sensor_msgs/msg/JointState", name=5), "each value of type 'str' - at `$.name`"),
        (broken("nav_msgs/msg/Path", poses=None), "each value of type 'PoseStamped' - at `$.poses`"),
        (
            broken("geometry_msgs/msg/Polygon", points=cls("geometry_msgs/msg/Point")()),
            "each value of type 'Point32' - at `$.points`",
        ),
        (broken("std_msgs/msg/ByteMultiArray", data=b"ab"), "each value of type 'bytes' - at `$.data`"),
        (
            cls("tf2_msgs/msg/TFMessage")(
                transforms=[cls("geometry_msgs/msg/TransformStamped")(child_frame_id="\ud800")]
            ),
            "surrogates not allowed - at `$.transforms[0].child_frame_id`",
        ),
    ],
)
def test_contents_that_have_become_wrong_are_named(message: Any, text: str) -> None:
    ours = support(message.__type_name__)
    with pytest.raises((TypeError, ValueError, AttributeError)):
        ours.encode(message)
    error = ours.explain(message)
    assert isinstance(error, MessageTypeError)
    assert str(error).startswith(f"{message.__type_name__}: The '") and text in str(error)
    with pytest.raises(MessageTypeError):
        serialize_message(message)


def test_a_deleted_field_is_named() -> None:
    message = cls("geometry_msgs/msg/Twist")()
    del message.linear._x
    assert "The 'x' field was deleted - at `$.linear.x`" in str(
        support(message.__type_name__).explain(message)
    )


def test_an_array_of_a_fixed_size_keeps_it() -> None:
    message = cls("sensor_msgs/msg/CameraInfo")()
    message._k = array("d", [0.0])
    with pytest.raises(ValueError, match="1 values, not 9"):
        support("sensor_msgs/msg/CameraInfo").encode(message)


def test_a_derived_message_goes_as_its_base() -> None:
    string = cls("std_msgs/msg/String")
    derived = type("Derived", (string,), {})
    assert type_support(derived) is type_support(string)
    assert type_support(string).encode(derived(data="x")) == type_support(string).encode(string(data="x"))
    derived_point = type("DerivedPoint", (cls("geometry_msgs/msg/Point32"),), {})
    polygon = cls("geometry_msgs/msg/Polygon")(points=[derived_point(x=1.0)])
    again = support("geometry_msgs/msg/Polygon").decode(support("geometry_msgs/msg/Polygon").encode(polygon))
    assert type(again.points[0]) is cls("geometry_msgs/msg/Point32")


def test_the_errors_of_a_publisher_know_the_class() -> None:
    string = cls("std_msgs/msg/String")
    assert bytes_fields(cls("sensor_msgs/msg/Image")) == ()
    assert str(wrong_class(string, "x")) == (
        "std_msgs/msg/String: expected a std_msgs.msg._string.String, got str"
    )
    assert "got std_msgs.msg._int32.Int32" in str(
        support("std_msgs/msg/String").explain(cls("std_msgs/msg/Int32")())
    )


def test_scalars_of_numpy_are_sent() -> None:
    np = pytest.importorskip("numpy")
    message = cls("geometry_msgs/msg/Point")(x=np.float64(0.5))
    again = support("geometry_msgs/msg/Point").decode(support("geometry_msgs/msg/Point").encode(message))
    assert again == message and type(again.x) is float
