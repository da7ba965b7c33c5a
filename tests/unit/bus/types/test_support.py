"""TypeSupport: names, hashes, and errors that name the field."""

import difflib
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
import pytest
from msgspec import Meta, Struct, field

import describedtypes
from bus.errors import ConfigurationError, MessageTypeError
from bus.msg import Message
from bus.msg._described import DESCRIBED
from bus.msg.geometry_msgs import Point, Pose, PoseArray, Twist, Vector3
from bus.msg.sensor_msgs import Imu, JointState
from bus.msg.std_msgs import Float32, Header, String
from bus.types.classes import described_service
from bus.types.classes import service_class as native_service
from bus.types.schema import build, describe
from bus.types.service import ServiceSupport
from bus.types.support import find_type, type_hash, type_name, type_support, wrong_class
from bus_ros.rosidl import service_class
from rows import for_each


class Wheel(Struct, rename="camel"):
    __type_name__: ClassVar[str] = "demo/msg/Wheel"

    wheel_index: Annotated[int, Meta(ge=0)] = 0
    poses: list[Pose] = field(default_factory=list)
    table: dict[str, Pose] = field(default_factory=dict)
    pair: tuple[int, Pose] = field(default_factory=lambda: (0, Pose()))
    maybe: Pose | None = None
    price: Annotated[str, Meta(pattern="^[$][0-9]+$")] = "$1"


class Tagged(Struct, tag="t", array_like=True):
    x: int = 0
    y: int = 0


def test_it_knows_the_class() -> None:
    support = type_support(String)
    assert support is type_support(String)
    assert support.cls is String
    assert support.name == "std_msgs/msg/String"
    assert support.hash == "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert support.schema == describe(String)
    assert support.decode(support.encode(String(data="hi"))) == String(data="hi")
    assert repr(support) == "TypeSupport(std_msgs/msg/String)"


@for_each("module, source", [("MODULE", "source"), ("SERVICE_MODULE", "service_source")])
def test_what_is_known_of_types_is_what_they_say(module: str, source: str) -> None:
    path = getattr(describedtypes, module)
    here, made = path.read_text().splitlines(), getattr(describedtypes, source)().splitlines()
    changed = [line[:100] for line in difflib.unified_diff(here, made, lineterm="", n=0)]
    assert not changed, f"{path} is of another time; run: make messages\n" + "\n".join(changed)


def test_messages_are_described_as_if_nothing_were_known_of_them() -> None:
    assert set(DESCRIBED) == {type_name(cls) for cls in describedtypes.all_messages()}
    for cls in describedtypes.all_messages():
        support = type_support(cls)
        assert (support.hash, support.description) == describedtypes.described(cls)
        assert support.schema == describe(cls)
        assert support.schema is support.schema


def test_a_service_that_is_described_is_as_if_nothing_were_known_of_it() -> None:
    for name in describedtypes.SERVICES:
        known, made = service_class(name), ServiceSupport(native_service(name))
        support = ServiceSupport(known)
        assert known.__described__  # type: ignore[attr-defined]
        for mine, its in ((support.requests, made.requests), (support.replies(b""), made.replies(b""))):
            assert (mine.name, mine.hash, mine.description) == (its.name, its.hash, its.description)
        assert support.request.name == known.Request.__type_name__ == f"{name}_Request"  # type: ignore[attr-defined]


def test_definitions_that_go_before_those_of_busd_are_not_described(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert described_service("rcl_interfaces/srv/GetParameters") is not None
    (tmp_path / "share" / "rcl_interfaces").mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert described_service("rcl_interfaces/srv/GetParameters") is None


def test_a_class_of_ones_own_is_not_taken_for_the_ready_made_one_of_that_name() -> None:
    class String(Message):
        __type_name__ = "std_msgs/msg/String"
        text: str = ""

    assert type_support(String).name == "std_msgs/msg/String"
    assert type_support(String).schema == describe(String)
    assert type_hash(String) != DESCRIBED["std_msgs/msg/String"][0]


def test_own_classes_work_the_same_way() -> None:
    support = type_support(Wheel)
    assert (support.name, support.hash) == (type_name(Wheel), type_hash(Wheel))
    assert support.hash.startswith("BUS01_")
    wheel = Wheel(wheel_index=3, poses=[Pose()])
    assert support.is_valid(msgspec.structs.replace(wheel)) is False  # not certain: `price` has a pattern
    assert support.explain(wheel) is None
    assert support.decode(support.encode(wheel)) == wheel
    assert type_support(Tagged).name == "local/msg/Tagged"


def test_a_decoder_reads_any_buffer_and_refuses_what_is_no_message() -> None:
    support = type_support(String)
    data = support.encode(String(data="hi"))
    for buffer in (bytearray(data), memoryview(data)):
        assert support.decode(buffer) == String(data="hi")
    for wrong in (b"", data[:-1], data + b"\x00", b"\xc1", b"\x91\x05", b"\x80"):
        with pytest.raises(msgspec.DecodeError):
            support.decode(wrong)


@for_each("wrong", [int, dict, 5, "std_msgs/msg/String", String(), None, []])
def test_only_a_message_class_has_it(wrong: Any) -> None:
    with pytest.raises(MessageTypeError, match=r"is no message class"):
        type_support(wrong)


def test_a_class_that_is_none_is_named() -> None:
    class NotAMessage:
        pass

    with pytest.raises(MessageTypeError, match=r"NotAMessage is no message class"):
        type_support(NotAMessage)  # type: ignore[type-var]


def test_a_bad_type_name_is_refused() -> None:
    cls = msgspec.defstruct("Foo", [], namespace={"__type_name__": "Foo"})
    with pytest.raises(ConfigurationError, match="three parts, like 'std_msgs/msg/String'; it is 'Foo'"):
        type_support(cls)


def test_foreign_classes_are_not_kept() -> None:
    foreign = build(describe(String))
    assert type_support(foreign) is not type_support(foreign)
    assert type_support(foreign).hash == type_support(String).hash


def deleted() -> Header:
    header = Header()
    del header.stamp.sec
    return header


def endless() -> JointState:
    message = JointState()
    message.name.append(message.name)  # type: ignore[arg-type]
    return message


WRONG: list[tuple[Any, str]] = [
    (String(data=5), "std_msgs/msg/String: Expected `str`, got `int` - at `$.data`"),  # type: ignore[arg-type]
    (Float32(data=True), "std_msgs/msg/Float32: Expected `float`, got `bool` - at `$.data`"),
    (
        Twist(linear=Vector3(x=0.5, z="up")),  # type: ignore[arg-type]
        "geometry_msgs/msg/Twist: Expected `float`, got `str` - at `$.linear.z`",
    ),
    (Imu(header=5), "sensor_msgs/msg/Imu: Expected `array`, got `int` - at `$.header`"),  # type: ignore[arg-type]
    (
        Imu(orientation_covariance=[0.0] * 8 + ["x"]),  # type: ignore[list-item]
        "sensor_msgs/msg/Imu: Expected `float`, got `str` - at `$.orientation_covariance[8]`",
    ),
    (
        Imu(orientation_covariance=[0.0] * 8),
        "sensor_msgs/msg/Imu: Expected `array` of length >= 9 - at `$.orientation_covariance`",
    ),
    (
        PoseArray(poses=[Pose(), Pose(position=None)]),  # type: ignore[arg-type]
        "geometry_msgs/msg/PoseArray: Expected `array`, got `None` - at `$.poses[1].position`",
    ),
    (
        String(data="\ud800"),
        "std_msgs/msg/String: 'utf-8' codec can't encode character '\\ud800' in position 0: "
        "surrogates not allowed - at `$.data`",
    ),
    (
        Float32(data=1j),  # type: ignore[arg-type]
        "std_msgs/msg/Float32: Encoding objects of type complex is unsupported - at `$.data`",
    ),
    (
        PoseArray(poses=[Pose(), Pose(position=object())]),  # type: ignore[arg-type]
        "geometry_msgs/msg/PoseArray: Encoding objects of type object is unsupported"
        " - at `$.poses[1].position`",
    ),
    (
        Float32(data=2**64),
        "std_msgs/msg/Float32: can't serialize ints < -2**63 or > 2**64 - 1 - at `$.data`",
    ),
    (deleted(), "std_msgs/msg/Header: Struct field 'sec' is unset - at `$.stamp.sec`"),
    (Wheel(wheel_index="1"), "demo/msg/Wheel: Expected `int`, got `str` - at `$.wheel_index`"),  # type: ignore[arg-type]
    (Wheel(wheel_index=-1), "demo/msg/Wheel: Expected `int` >= 0 - at `$.wheel_index`"),
    (
        Wheel(poses=[Pose(position=5)]),  # type: ignore[arg-type]
        "demo/msg/Wheel: Expected `array`, got `int` - at `$.poses[0].position`",
    ),
    (
        Wheel(table={"a": Pose(position=5)}),  # type: ignore[arg-type]
        "demo/msg/Wheel: Expected `array`, got `int` - at `$.table[...].position`",
    ),
    (
        Wheel(table={5: Pose()}),  # type: ignore[dict-item]
        "demo/msg/Wheel: Expected `str`, got `int` - at `key` in `$.table`",
    ),
    (
        Wheel(table={"a": 1j}),  # type: ignore[dict-item]
        "demo/msg/Wheel: Encoding objects of type complex is unsupported - at `$.table['a']`",
    ),
    (
        Wheel(pair=(1, Pose(position=5))),  # type: ignore[arg-type]
        "demo/msg/Wheel: Expected `array`, got `int` - at `$.pair[1].position`",
    ),
    (
        Wheel(maybe=Pose(position=5)),  # type: ignore[arg-type]
        "demo/msg/Wheel: Expected `array`, got `int` - at `$.maybe.position`",
    ),
    (
        Wheel(price="1"),
        "demo/msg/Wheel: Expected `str` matching regex '^[$][0-9]+$' - at `$.price`",
    ),
    (
        Twist(linear=Point()),  # type: ignore[arg-type]
        "geometry_msgs/msg/Twist: Expected `geometry_msgs/msg/Vector3`, "
        "got `bus.msg.geometry_msgs.Point` - at `$.linear`",
    ),
    (
        PoseArray(poses=[Pose(), Pose(position=[1.0, 2.0, 3.0])]),  # type: ignore[arg-type]
        "geometry_msgs/msg/PoseArray: Expected `geometry_msgs/msg/Point`, got `list`"
        " - at `$.poses[1].position`",
    ),
    (Tagged(y="a"), "local/msg/Tagged: Expected `int`, got `str` - at `$.y`"),  # type: ignore[arg-type]
]


@for_each(("message", "text"), WRONG)
def test_the_error_names_the_field(message: Any, text: str) -> None:
    error = type_support(type(message)).explain(message)
    assert isinstance(error, MessageTypeError)
    assert str(error) == text


def test_a_message_that_contains_itself_is_refused() -> None:
    error = type_support(JointState).explain(endless())
    assert "recursion" in str(error)


def test_fields_of_a_foreign_class_are_named_too() -> None:
    foreign: Any = build(describe(Twist))
    message = foreign()
    message.linear.z = "up"
    error = type_support(foreign).explain(message)
    assert str(error) == "geometry_msgs/msg/Twist: Expected `float`, got `str` - at `$.linear.z`"


@for_each(
    ("cls", "message", "text"),
    [
        (
            String,
            "hi",
            "std_msgs/msg/String: expected a bus.msg.std_msgs.String, got str; write String(data=...)",
        ),
        (
            String,
            String,
            "std_msgs/msg/String: expected a bus.msg.std_msgs.String, got the class String; write String()",
        ),
        (
            String,
            None,
            "std_msgs/msg/String: expected a bus.msg.std_msgs.String, got NoneType; write String(data=...)",
        ),
        (
            Twist,
            Vector3(),
            "geometry_msgs/msg/Twist: expected a bus.msg.geometry_msgs.Twist, "
            "got bus.msg.geometry_msgs.Vector3",
        ),
        (Twist, 0.5, "geometry_msgs/msg/Twist: expected a bus.msg.geometry_msgs.Twist, got float"),
    ],
)
def test_an_object_of_another_class_is_explained(cls: type[Message], message: Any, text: str) -> None:
    assert str(wrong_class(cls, message)) == text
    assert str(type_support(cls).explain(message)) == text


@for_each(
    "name",
    [
        *("", "/", "std_msgs", "std_msgs/", "std_msgs/msg", "std_msgs/msg/", "std_msgs/Nothing", "String"),
        *("std_msgs/msg/Time", "std_msgs/srv/String", "std_msgs/msg/msg/String", "std_msgs/msg/__all__"),
        *(
            "std_msgs/msg/Message",
            "_types/msg/Message",
            "os/msg/path",
            "../std_msgs/String",
            "no_msgs/msg/String",
        ),
        *("std_msgs/msg/string", "std_msgs/msg/__name__", "geometry_msgs/msg/Header", "local/msg/Wheel"),
    ],
)
def test_there_is_no_such_type(name: str) -> None:
    assert find_type(name) is None


def test_a_type_is_found_by_either_name() -> None:
    assert find_type("std_msgs/msg/String") is find_type("std_msgs/String") is String


def test_importing_it_imports_no_large_packages() -> None:
    script = "import sys, bus.types.support; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    assert {"bus.msg.geometry_msgs", "bus.msg.nav_msgs", "bus.msg.sensor_msgs"}.isdisjoint(loaded.split())
