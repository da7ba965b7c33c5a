"""Message classes as rosidl makes them: constructors, assertions, texts, equality, copies."""

import copy
import pickle
import subprocess
import sys
from array import array
from pathlib import Path
from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.types.support import type_support
from bus_ros.rosidl import RosMessage, action_class, definition, message_class, service_class
from bus_ros.rosidl.classes import _make, module_of
from rows import for_each

DEFINITION = """
int32 LIMIT=3
string WORD="a # b"
string<=5 name "ab"
float32[<=3] xs
byte octet 7
byte[] octets
bool[2] flags
uint8[4] address [1, 2, 3, 4]
string<=2[] names
geometry_msgs/Point[2] corners
int64[] big [1, 2]
wstring wide
float64 from 2.5
char code
float64[3] fixed
"""


def cls(name: str) -> Any:
    return message_class(name)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A class with a field of each kind."""
    folder = tmp_path_factory.mktemp("interfaces")
    path = folder / "rosidl_test_interfaces" / "msg" / "Everything.msg"
    path.parent.mkdir(parents=True)
    path.write_text(DEFINITION)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BUS_INTERFACE_PATH", str(folder))
        return cls("rosidl_test_interfaces/msg/Everything")


def listed(value: Any) -> Any:
    """The array as a list. It may be numpy's."""
    return value.tolist()


def test_fields_are_keyword_arguments_with_defaults() -> None:
    assert cls("std_msgs/msg/String")().data == ""
    assert cls("std_msgs/msg/String")(data="hi").data == "hi"
    assert cls("std_msgs/msg/Byte")().data == b"\x00"
    assert cls("geometry_msgs/msg/Quaternion")().w == 1.0
    assert cls("geometry_msgs/msg/Pose")().orientation.w == 1.0
    with pytest.raises(TypeError):
        cls("std_msgs/msg/String")("hi")


def test_defaults_are_not_shared(own: Any) -> None:
    first, second = own(), own()
    first.names.append("x")
    first.corners[0].x = 1.0
    first.big.append(3)
    first.fixed[0] = 1.0
    first.octets.append(b"x")
    assert (second.names, second.corners[0].x, listed(second.big)) == ([], 0.0, [1, 2])
    assert (listed(second.fixed), second.octets) == ([0.0, 0.0, 0.0], [])


def test_an_unknown_argument_is_named() -> None:
    text = "Invalid arguments passed to constructor: dat, x"
    with pytest.raises(AssertionError, match=f"^{text}$"):
        cls("std_msgs/msg/String")(x=1, data="", dat="")
    with pytest.raises(AttributeError):
        cls("std_msgs/msg/String")().dat = ""


def test_what_the_class_tells(own: Any) -> None:
    types = own.get_fields_and_field_types()
    assert types == {
        "name": "string<5>",
        "xs": "sequence<float, 3>",
        "octet": "octet",
        "octets": "sequence<octet>",
        "flags": "boolean[2]",
        "address": "uint8[4]",
        "names": "sequence<string<2>>",
        "corners": "geometry_msgs/Point[2]",
        "big": "sequence<int64>",
        "wide": "wstring",
        "from": "double",
        "code": "uint8",
        "fixed": "double[3]",
    }
    types.clear()
    assert own.get_fields_and_field_types()
    assert own._fields_and_field_types == own.get_fields_and_field_types()
    assert own.__slots__ == [f"_{name}" for name in own.get_fields_and_field_types()]
    assert (own.LIMIT, own().LIMIT, own.WORD, own.NAME__DEFAULT) == (3, 3, "a # b", "ab")
    assert getattr(own(), "from") == 2.5
    assert own.name.__doc__ == "Message field 'name'."
    assert cls("visualization_msgs/msg/Marker").SPHERE == 2


def test_slot_types(own: Any) -> None:
    d = definition
    assert own.SLOT_TYPES[:6] == (
        d.BoundedString(5),
        d.BoundedSequence(d.BasicType("float"), 3),
        d.BasicType("octet"),
        d.UnboundedSequence(d.BasicType("octet")),
        d.Array(d.BasicType("boolean"), 2),
        d.Array(d.BasicType("uint8"), 4),
    )
    corners = own().SLOT_TYPES[7]
    assert isinstance(corners, d.Array) and corners.size == 2
    assert isinstance(corners.value_type, d.NamespacedType)
    assert corners.value_type.namespaced_name() == ("geometry_msgs", "msg", "Point")
    assert isinstance(own.SLOT_TYPES[8], d.AbstractSequence) and not own.SLOT_TYPES[8].has_maximum_size()
    assert d.BasicType("double") != d.BasicType("float") and hash(d.UnboundedString()) is not None


def test_names_are_those_of_ros() -> None:
    string = cls("std_msgs/msg/String")
    assert repr(string) == "<class 'std_msgs.msg._string.String'>"
    assert string is cls("std_msgs/msg/String")
    assert string.__type_name__ == "std_msgs/msg/String"
    assert module_of("std_msgs/msg/ColorRGBA") == "std_msgs.msg._color_rgba"
    assert module_of("std_msgs/msg/UInt8MultiArray") == "std_msgs.msg._u_int8_multi_array"
    assert module_of("std_srvs/srv/SetBool_Request") == "std_srvs.srv._set_bool"


def test_its_text_is_that_of_rosidl(own: Any) -> None:
    twist = cls("geometry_msgs/msg/Twist")()
    twist.linear.x = 0.5
    zeros = "x=0.0, y=0.0, z=0.0"
    assert repr(twist) == (
        "geometry_msgs.msg.Twist(linear=geometry_msgs.msg.Vector3(x=0.5, y=0.0, z=0.0), "
        f"angular=geometry_msgs.msg.Vector3({zeros}))"
    )
    text = repr(own(xs=[1.0, 0.5], octets=[b"a"], names=["a"]))
    assert text.startswith(
        "rosidl_test_interfaces.msg.Everything(name='ab', xs=[1.0, 0.5], octet=b'\\x07', octets=[b'a'], "
        "flags=[False, False], address="
    )
    assert f"names=['a'], corners=[geometry_msgs.msg.Point({zeros}), " in text
    assert "big=[1, 2], wide='', from=2.5, code=0, fixed=" in text
    assert repr(cls("std_msgs/msg/Empty")()) == "std_msgs.msg.Empty()"
    assert "ranges=[], intensities=[]" in repr(cls("sensor_msgs/msg/LaserScan")())


@for_each(
    ("name", "field", "value", "text"),
    [
        ("std_msgs/msg/String", "data", 5, "The 'data' field must be of type 'str'"),
        ("std_msgs/msg/Bool", "data", 1, "The 'data' field must be of type 'bool'"),
        ("std_msgs/msg/Int8", "data", 128, "The 'data' field must be an integer in [-128, 127]"),
        ("std_msgs/msg/Int8", "data", 1.0, "The 'data' field must be of type 'int'"),
        ("std_msgs/msg/UInt8", "data", -1, "The 'data' field must be an unsigned integer in [0, 255]"),
        ("std_msgs/msg/Char", "data", 256, "The 'data' field must be an unsigned integer in [0, 255]"),
        ("std_msgs/msg/Float64", "data", 1, "The 'data' field must be of type 'float'"),
        (
            "std_msgs/msg/Float32",
            "data",
            1e39,
            "The 'data' field must be a float in [-3.402823466e+38, 3.402823466e+38]",
        ),
        (
            "std_msgs/msg/Byte",
            "data",
            b"ab",
            "The 'data' field must be of type 'bytes' or 'ByteString' with length 1",
        ),
        ("geometry_msgs/msg/Twist", "linear", None, "must be a sub message of type 'Vector3'"),
        (
            "sensor_msgs/msg/JointState",
            "name",
            ["a", 1],
            "The 'name' field must be a set or sequence and each value of type 'str'",
        ),
        ("sensor_msgs/msg/JointState", "name", "abc", "The 'name' field must be a set or sequence"),
        ("sensor_msgs/msg/JointState", "position", 5.0, "The 'position' field must be a set or sequence"),
        ("sensor_msgs/msg/JointState", "position", ["1"], "The 'position' field must be a set or sequence"),
        ("std_msgs/msg/Int8MultiArray", "data", [1.5], "The 'data' field must be a set or sequence"),
        (
            "sensor_msgs/msg/LaserScan",
            "ranges",
            [1e39],
            "and each float in [-340282346600000016151267322115014000640.000000, ",
        ),
        (
            "std_msgs/msg/Int8MultiArray",
            "data",
            [128],
            "must be a set or sequence and each value of type 'int' and each integer in [-128, 127]",
        ),
        (
            "std_msgs/msg/UInt16MultiArray",
            "data",
            [-1],
            "and each value of type 'int' and each unsigned integer in [0, 65535]",
        ),
        (
            "sensor_msgs/msg/CameraInfo",
            "k",
            [0.0],
            "The 'k' field must be a set or sequence with length 9 and each value of type 'float'",
        ),
    ],
)
def test_a_wrong_value_is_refused_in_the_words_of_ros(name: str, field: str, value: Any, text: str) -> None:
    message = cls(name)()
    before = repr(message)
    for assign in (lambda: setattr(message, field, value), lambda: cls(name)(**{field: value})):
        with pytest.raises(AssertionError) as caught:
            assign()
        assert text in str(caught.value)
    assert repr(message) == before


@for_each(
    ("name", "field", "value", "text"),
    [
        (
            "sensor_msgs/msg/JointState",
            "position",
            [1.0, 2],
            "must be a set or sequence and each value of type 'float' and each double in [-17976931348",
        ),
        (
            "sensor_msgs/msg/LaserScan",
            "ranges",
            array("d"),
            "The 'ranges' array.array() must have the type code of 'f'",
        ),
        (
            "geometry_msgs/msg/Polygon",
            "points",
            [None],
            "The 'points' field must be a set or sequence and each value of type 'Point32'",
        ),
        (
            "sensor_msgs/msg/JointState",
            "name",
            iter("ab"),
            "The 'name' field must be a set or sequence and each value of type 'str'",
        ),
        ("sensor_msgs/msg/JointState", "effort", iter([1.0]), "The 'effort' field must be a set or sequence"),
        ("std_msgs/msg/String", "data", 5, "The 'data' field must be of type 'str'"),
    ],
)
def test_strict_checks(name: str, field: str, value: Any, text: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
        strict: Any = _make(name)
    message = strict()
    before = repr(message)
    with pytest.raises(AssertionError) as caught:
        setattr(message, field, value)
    assert text in str(caught.value)
    assert repr(message) == before


@for_each(
    ("name", "field", "value", "stored"),
    [
        ("sensor_msgs/msg/LaserScan", "ranges", [0] * 3, array("f", [0.0] * 3)),
        ("sensor_msgs/msg/LaserScan", "ranges", range(3), array("f", [0.0, 1.0, 2.0])),
        ("sensor_msgs/msg/LaserScan", "ranges", {1: None}.keys(), array("f", [1.0])),
        ("sensor_msgs/msg/LaserScan", "ranges", array("d", [0.5]), array("f", [0.5])),
        ("sensor_msgs/msg/JointState", "position", array("f", [0.5]), array("d", [0.5])),
        ("sensor_msgs/msg/JointState", "position", array("i", [2]), array("d", [2.0])),
        ("sensor_msgs/msg/JointState", "position", map(float, "12"), array("d", [1.0, 2.0])),
        ("sensor_msgs/msg/JointState", "position", {1: 2.5}.values(), array("d", [2.5])),
        ("std_msgs/msg/Int32MultiArray", "data", array("b", [-1]), array("i", [-1])),
        ("std_msgs/msg/UInt8MultiArray", "data", map(int, "12"), array("B", [1, 2])),
        ("sensor_msgs/msg/JointState", "name", map(str, [1, 2]), ["1", "2"]),
        ("sensor_msgs/msg/JointState", "name", {1: "a"}.values(), ["a"]),
    ],
)
def test_sequences_are_converted(name: str, field: str, value: Any, stored: Any) -> None:
    message = cls(name)()
    setattr(message, field, value)
    assert getattr(message, field) == stored and type(getattr(message, field)) is type(stored)


def test_arrays_of_a_fixed_size_are_converted() -> None:
    info = cls("sensor_msgs/msg/CameraInfo")(k=range(9))
    assert listed(info.k) == [float(i) for i in range(9)]
    info.k = array("i", range(9))
    assert listed(info.k) == [float(i) for i in range(9)]
    info.k = (0.5 for _ in range(9))
    assert listed(info.k) == [0.5] * 9
    with pytest.raises(AssertionError, match="with length 9"):
        info.k = range(8)


def test_messages_in_a_sequence_are_checked_when_they_are_sent() -> None:
    polygon, point = cls("geometry_msgs/msg/Polygon"), cls("geometry_msgs/msg/Point32")
    support: Any = type_support(polygon)
    message = polygon(points=(point(x=float(x)) for x in range(2)))
    assert [one.x for one in support.decode(support.encode(message)).points] == [0.0, 1.0]
    message.points = [point(), None]
    with pytest.raises(TypeError, match="'NoneType' is no Point32"):
        support.encode(message)
    assert "each value of type 'Point32' - at `$.points`" in str(support.explain(message))


@pytest.mark.parametrize(
    ("field", "value", "text"),
    [
        ("name", "abcdef", "The 'name' field must be string value not longer than 5"),
        ("xs", [0.0] * 4, "The 'xs' field must be a set or sequence with length <= 3 and each value"),
        ("xs", array("f", [0.0] * 4), "The 'xs' array.array() must have a size <= 3"),
        ("flags", [True], "The 'flags' field must be a set or sequence with length 2 and each value"),
        ("names", ["abc"], "sequence and each string value not longer than 2 and each value of type 'str'"),
        ("octets", [b"ab"], "The 'octets' field must be a set or sequence and each value of type 'bytes'"),
        ("address", [1, 2, 3], "The 'address' field must be a set or sequence with length 4 and each value"),
    ],
)
def test_limits_of_an_own_definition(own: Any, field: str, value: Any, text: str) -> None:
    with pytest.raises(AssertionError) as caught:
        setattr(own(), field, value)
    assert text in str(caught.value)


def test_equality(own: Any) -> None:
    assert own() == own()
    assert own(fixed=[1.0, 2.0, 3.0]) != own()
    assert own(xs=[1.0]) != own(xs=[1.5])
    assert cls("geometry_msgs/msg/Vector3")() != cls("geometry_msgs/msg/Point")()
    assert cls("std_msgs/msg/String")() != ""
    with pytest.raises(TypeError, match="unhashable"):
        hash(own())


class Loud(message_class("std_msgs/msg/String")):  # type: ignore[misc]
    """A class that a program derives."""

    def shout(self) -> str:
        return str(self.data).upper()


def test_it_can_be_derived_from() -> None:
    loud = Loud(data="hi")
    loud.extra = 5
    assert loud.shout() == "HI"
    assert repr(loud).endswith(".Loud(data='hi')")
    again = pickle.loads(pickle.dumps(loud))
    assert (type(again), again.data, again.extra) == (Loud, "hi", 5)


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies(own: Any, way: Any) -> None:
    message = own(xs=[1.0], fixed=[1.0, 2.0, 3.0], names=["a"])
    copied = way(message)
    assert type(copied) is own and copied == message and copied is not message
    copied.names = ["b"]
    assert message.names == ["a"]


def test_a_deep_copy_shares_nothing(own: Any) -> None:
    message = own()
    copied = copy.deepcopy(message)
    copied.corners[0].x = 1.0
    copied.fixed[0] = 1.0
    assert message == own()


def test_services_and_actions() -> None:
    service = service_class("example_interfaces/srv/AddTwoInts")
    assert service is service_class("example_interfaces/AddTwoInts")
    assert repr(service) == "<class 'example_interfaces.srv._add_two_ints.AddTwoInts'>"
    assert service.Request is cls("example_interfaces/srv/AddTwoInts_Request")  # type: ignore[attr-defined]
    request: RosMessage = service.Request(a=1, b=2)  # type: ignore[attr-defined]
    assert repr(request) == "example_interfaces.srv.AddTwoInts_Request(a=1, b=2)"
    assert service.Response().sum == 0  # type: ignore[attr-defined]
    with pytest.raises(NotImplementedError, match="Service classes can not be instantiated"):
        service()
    action: Any = action_class("example_interfaces/action/Fibonacci")
    assert action.Goal(order=5).order == 5
    assert listed(action.Result().sequence) == listed(action.Feedback().sequence) == []
    assert action.Impl is action.Impl
    assert action.Impl.FeedbackMessage(feedback=action.Feedback(sequence=[1])).feedback.sequence[0] == 1
    assert action.Impl.SendGoalService.Request is cls("example_interfaces/action/Fibonacci_SendGoal_Request")


def test_what_is_not_there_is_said() -> None:
    with pytest.raises(ConfigurationError, match="unknown interface 'std_msgs/msg/Strin'"):
        message_class("std_msgs/msg/Strin")
    with pytest.raises(ConfigurationError, match="std_msgs/msg/String is no service"):
        service_class("std_msgs/String")


def run(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PATH": "", "PYTHONPATH": ":".join(sys.path), **environment},
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_checks_can_be_left_out() -> None:
    code = (
        "from bus_ros.rosidl import message_class\n"
        "from bus.types.support import type_support\n"
        "String, Joints = map(message_class, ('std_msgs/msg/String', 'sensor_msgs/msg/JointState'))\n"
        "print(String(data=5, x=6).data, Joints(position=[1, 2]).position.typecode)\n"
        "support = type_support(String)\n"
        "print(support.is_valid(String(data=5)), support.is_valid(String(data='x')))\n"
        "print(support.explain(String(data=5)))\n"
    )
    assert run(code, ROS_PYTHON_CHECK_FIELDS="0").splitlines() == [
        "5 d",
        "False True",
        "std_msgs/msg/String: The 'data' field must be of type 'str' - at `$.data`",
    ]
