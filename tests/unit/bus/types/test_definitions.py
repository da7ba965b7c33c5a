"""The search for definitions, and the native classes made from them."""

import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from bus.errors import ConfigurationError
from bus.msg import PACKAGES
from bus.msg.std_msgs import String
from bus.types import classes, definitions
from bus.types.classes import find_class, message_class, service_class
from bus.types.definitions import (
    definition_path,
    exists,
    find_definition,
    find_message,
    full_name,
    names,
    packages,
)
from bus.types.idl import Message
from bus.types.schema import describe
from bus.types.support import find_type, type_hash, type_support
from bus_ros import rosidl
from daily_types import daily_part
from rows import for_each

READY_MADE = [
    f"{package}/msg/{name}" for package in PACKAGES for name in import_module(f"bus.msg.{package}").__all__
]
SHIPPED = [
    f"{path.parent.parent.name}/{path.parent.name}/{path.stem}"
    for path in sorted((Path(definitions.__file__).parents[1] / "share").glob("*/*/*"))
    if path.parent.name != "launch"
]
HASHES_OF_ROS = {
    "actionlib_msgs/msg/GoalStatus": "c90c64230954d90ee079cbdd22a14bca3650b3d403f5cc3faf0eee992c6ae9ff",
    "type_description_interfaces/msg/FieldType": (
        "a70b6dd919645a03a3586f7f821defbc886ea3e531a1d95cc0f380a3973ccaa6"
    ),
    "type_description_interfaces/msg/TypeDescription": (
        "739f2508c9fa3a6f330913ff5b9d25fb74159a077da71e1087f51a60c12a080b"
    ),
    "type_description_interfaces/srv/GetTypeDescription_Response": (
        "648c49d976240861a482f961c5621ddd0d2135d8cce6f297a76d4f6376d93b75"
    ),
    "service_msgs/msg/ServiceEventInfo": "41bcbbe07a75c9b52bc96bfd5c24d7f0fc0a08c0cb7921b3373c5732345a6f45",
    "stereo_msgs/msg/DisparityImage": "1ec1ff6b5bace919e4544a37f2d96ead9f81783701b7b7a4d97a09325ecf2711",
    "rcl_interfaces/srv/GetParameters_Event": (
        "84eeb9247b09067c35bd8750d5c8555b700e394a616737c4624f15ae02e64c4d"
    ),
    "unique_identifier_msgs/msg/UUID": "1b8e8aca958cbea28fe6ef60bf6c19b683c97a9ef60bb34752067d0f2f7ab437",
    "visualization_msgs/msg/Marker": "45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0",
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4"
    ),
    "rcl_interfaces/msg/ParameterDescriptor": (
        "52175dbfda6c51153101d33d2a9da05743f66f02d5ab2ca9ec4709b46b73d704"
    ),
    "shape_msgs/msg/Plane": "dfbfe8314689c850615d4a727af017e9aa86c10e369a606c8c851ef8f16c58c8",
    "trajectory_msgs/msg/JointTrajectory": "179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    "action_msgs/msg/GoalStatusArray": "6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e",
}
LESSON = """
    std_msgs/msg/String geometry_msgs/msg/Twist nav_msgs/msg/Odometry example_interfaces/srv/AddTwoInts
    turtlesim/msg/Pose rcl_interfaces/msg/SetParametersResult example_interfaces/action/Fibonacci
    std_srvs/srv/SetBool visualization_msgs/msg/Marker action_msgs/msg/GoalStatus turtlesim/srv/Spawn
    tf2_msgs/msg/TFMessage rosgraph_msgs/msg/Clock lifecycle_msgs/msg/State
"""


@pytest.fixture(autouse=True)
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only shipped definitions and those of the test are found, and no class outlives its test."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("BUS_INTERFACE_PATH", raising=False)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "program.py")])
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(classes, "_classes", {})
    service_class.cache_clear()


def write(folder: Path, name: str, text: str) -> Path:
    package, kind, short = name.split("/")
    path = folder / package / kind / f"{short}.{kind}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of packages in the search path."""
    folder = tmp_path / "own"
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(folder))
    return folder


def make(own: Path, text: str, name: str = "demo/msg/Wheel") -> Any:
    write(own, name, text)
    return message_class(name)


def test_ready_made_classes_are_what_is_made_of_their_definitions(monkeypatch: pytest.MonkeyPatch) -> None:
    ready_made = {name: find_class(name) for name in READY_MADE}
    for name, cls in ready_made.items():
        assert cls is not None and message_class(name) is cls
    monkeypatch.setattr(classes, "_ready_made", lambda name: None)
    monkeypatch.setattr(classes, "_classes", {})
    for name, cls in ready_made.items():
        assert cls is not None
        made = message_class(name)
        assert made is not cls
        assert describe(made) == describe(cls)
        assert type_hash(made) == type_hash(cls)
        assert constants(made) == constants(cls)
        assert repr(made()) == repr(cls())


def constants(cls: type) -> dict[str, object]:
    return {name: value for name, value in vars(cls).items() if name.isupper()}


def test_what_is_shipped_makes_classes_that_ros_would_know() -> None:
    assert len(SHIPPED) > 150
    for definition in map(find_definition, daily_part(SHIPPED)):
        for message in [definition] if isinstance(definition, Message) else definition[1:]:
            support = type_support(message_class(message.name))
            assert support.name == message.name
            assert support.hash.startswith("RIHS01_")
            default = support.cls()
            assert support.is_valid(default) or support.explain(default) is None
            assert support.decode(support.encode(default)) == default


@for_each("name", HASHES_OF_ROS)
def test_hashes_are_those_of_ros(name: str) -> None:
    assert type_hash(message_class(name)) == f"RIHS01_{HASHES_OF_ROS[name]}"


def test_ready_made_services_are_what_their_definitions_say() -> None:
    from bus.srv import PACKAGES as services

    for name in (name for package in services for name in names("srv", package)):
        for part in find_definition(name)[1:]:
            assert isinstance(part, Message)
            assert type_hash(message_class(part.name)) == type_hash(classes._make(part))


def test_services() -> None:
    from bus.srv.std_srvs import SetBool

    assert service_class("std_srvs/srv/SetBool") is SetBool
    spawn = service_class("turtlesim/srv/Spawn")
    assert spawn is service_class("turtlesim/srv/Spawn") and spawn.__type_name__ == "turtlesim/srv/Spawn"
    assert spawn.Request is message_class("turtlesim/srv/Spawn_Request")
    assert spawn.Response is message_class("turtlesim/srv/Spawn_Response")
    for wrong in ("std_msgs/msg/String", "turtlesim/srv/Spawm", "turtlesim/action/RotateAbsolute", "Spawn"):
        with pytest.raises(ConfigurationError):
            service_class(wrong)


def test_what_lessons_need_is_there() -> None:
    assert set(LESSON.split()) <= set(names())
    assert "std_msgs" in packages() and sorted(packages()) == packages()
    assert names("action", "turtlesim") == ["turtlesim/action/RotateAbsolute"]
    assert names("srv", "std_msgs") == names(package="nothing") == []
    assert names(package="turtlesim")[:2] == ["turtlesim/msg/Color", "turtlesim/msg/Pose"]


def test_constants_and_defaults(own: Path) -> None:
    cls = make(
        own,
        'int8 LEFT=-1\nbyte OK=2\nstring HI="hi"\n'
        "float64 x 1.5\nint8[] xs [1, 2]\nuint8[3] octets [1, 2, 3]\nbyte[] bytes [7]\nwstring wide 'w'\n"
        "bool[2] flags\nuint8[4] zeros\ngeometry_msgs/Quaternion[2] turns\nuint8[<=2] few\n",
    )
    assert (cls.LEFT, cls.OK, cls.HI) == (-1, b"\x02", "hi")
    wheel = cls()
    assert (wheel.x, wheel.xs, wheel.octets, wheel.bytes, wheel.wide) == (1.5, [1, 2], b"\1\2\3", b"\7", "w")
    assert (wheel.flags, wheel.zeros, wheel.few) == ([False, False], bytes(4), b"")
    assert [turn.w for turn in wheel.turns] == [1.0, 1.0]
    assert wheel.xs is not cls().xs and wheel.turns[0] is not wheel.turns[1]
    support = type_support(cls)
    assert (support.name, support.is_valid(wheel)) == ("demo/msg/Wheel", True)
    assert support.decode(support.encode(wheel)) == wheel
    assert repr(wheel).startswith("demo.msg.Wheel(x=1.5, xs=[1, 2], octets=[1, 2, 3], ")


@pytest.mark.parametrize(
    ("field", "value"),
    [("octets", b"ab"), ("few", b"abc"), ("flags", [True]), ("short", "abcd"), ("many", [1, 2, 3])],
)
def test_limits_are_held(own: Path, field: str, value: object) -> None:
    cls = make(own, "uint8[3] octets\nuint8[<=2] few\nbool[2] flags\nstring<=3 short\nint8[<=2] many\n")
    support = type_support(cls)
    message = cls(**{field: value})
    assert not support.is_valid(message)
    assert f"$.{field}" in str(support.explain(message))


def test_hashes_of_bounded_strings_are_those_of_ros(own: Path) -> None:
    write(own, "rmw_dds_common/msg/Gid", "char[16] data")
    strings = "string<=256 node_namespace\nstring<=256 node_name\n"
    write(
        own, "rmw_dds_common/msg/NodeEntitiesInfo", f"{strings}Gid[] reader_gid_seq\nGid[] writer_gid_seq\n"
    )
    write(
        own,
        "rmw_dds_common/msg/ParticipantEntitiesInfo",
        "Gid gid\nNodeEntitiesInfo[] node_entities_info_seq\n",
    )
    expected = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"
    assert type_hash(message_class("rmw_dds_common/msg/ParticipantEntitiesInfo")) == expected


def test_a_class_is_made_once_and_has_its_neighbours(own: Path) -> None:
    write(own, "demo/msg/Spoke", "std_msgs/String label")
    cls = make(own, "Spoke first\nSpoke[] others\n")
    assert message_class("demo/msg/Wheel") is cls is find_type("demo/Wheel") is find_type("demo/msg/Wheel")
    assert type(cls().first) is message_class("demo/msg/Spoke")  # type: ignore[attr-defined]
    assert type(cls().first.label) is String  # type: ignore[attr-defined]


def test_a_field_may_be_a_word_of_python(own: Path) -> None:
    support = type_support(make(own, "string from\nstring class\n"))
    message = support.cls(**{"from": "a", "class": "b"})
    assert getattr(message, "from") == "a"
    assert support.explain(message) is None
    assert support.decode(support.encode(message)) == message


def test_parts_of_services_and_actions(own: Path) -> None:
    write(own, "demo/srv/Turn", "int8 a\n---\nint8 b\n")
    assert find_message("demo/srv/Turn_Response").fields[0].name == "b"
    assert message_class("demo/srv/Turn_Request")(a=3) == message_class("demo/srv/Turn_Request")(a=3)
    with pytest.raises(ConfigurationError, match="say demo/srv/Turn_Request or demo/srv/Turn_Response"):
        message_class("demo/srv/Turn")
    with pytest.raises(ConfigurationError, match="unknown interface"):
        message_class("demo/srv/Turn_Goal")
    write(own, "demo/action/Roll", "int8 a\n---\nint8 b\n---\nint8 c\n")
    carrier: Any = message_class("demo/action/Roll_FeedbackMessage")
    assert (len(carrier().goal_id.uuid), carrier().feedback.c) == (16, 0)
    names_of_response = [field.name for field in find_message("demo/action/Roll_GetResult_Response").fields]
    assert names_of_response == ["status", "result"]


@for_each(
    "name",
    [
        "std_msgs/msg/Strin",
        "nope/msg/X",
        "std_msgs",
        "",
        "../../etc/msg/X",
        "std_msgs/msg/../String",
        "a/b/c",
    ],
)
def test_there_is_no_such_interface(name: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^unknown interface '{re.escape(name)}'"):
        definition_path(name)
    with pytest.raises(ConfigurationError, match=r"^unknown interface"):
        message_class(name)
    assert find_class(name) is None


def test_whether_there_is_a_definition() -> None:
    there = [
        "std_msgs/msg/String",
        "std_srvs/srv/SetBool",
        "std_srvs/srv/SetBool_Request",
        "std_srvs/srv/SetBool_Event",
        "example_interfaces/action/Fibonacci_FeedbackMessage",
        "example_interfaces/action/Fibonacci_SendGoal_Request",
    ]
    for name in there:
        assert exists(name), name
        assert not exists(name.replace("String", "Strin").replace("SetBool", "SetB").replace("Fib", "F"))
    for name in ("", "/", "_", "std_msgs", "std_msgs/String", "a/b/c/d", "std_msgs/msg/../msg/String"):
        assert not exists(name), name
    for name in ("std_msgs/msg/String_Request", "std_srvs/srv/SetBool_Goal", "std_srvs/srv/SetBool_"):
        assert not exists(name), name  # the error of `find_message` would take long
    assert all(map(exists, READY_MADE))


def test_the_nearest_name_is_told() -> None:
    with pytest.raises(ConfigurationError, match="did you mean 'geometry_msgs/msg/Twist'"):
        find_definition("geometry_msgs/msg/Twits")


def test_the_nearest_name_is_another_one(own: Path) -> None:
    write(own, "demo/msg/Wheel", "int32 x\n")
    (own / "demo" / "msg" / "Wheels.msg").mkdir()
    with pytest.raises(ConfigurationError, match="'demo/msg/Wheels'; did you mean 'demo/msg/Wheel'"):
        find_definition("demo/msg/Wheels")


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("Int32 x", "'Int32' is not a known type; did you mean 'int32'?"),
        ("String x", "'String' is not a known type; did you mean 'string'?"),
        ("Twist x", "'Twist' is not a known type; did you mean 'geometry_msgs/Twist'?"),
        ("std_msgs/Twist x", "'std_msgs/Twist' is not a known type; did you mean 'geometry_msgs/Twist'?"),
        ("Nonsense x", "'Nonsense' is not a known type"),
    ],
)
def test_a_type_that_is_not_there_is_told_with_its_line(own: Path, line: str, hint: str) -> None:
    write(own, "demo/msg/Wheel", f"# a wheel\n\n{line}\n")
    with pytest.raises(ConfigurationError) as caught:
        find_definition("demo/msg/Wheel")
    assert str(caught.value).startswith(f"demo/msg/Wheel.msg:3: {hint}")


def test_a_malformed_definition_hurts_only_who_asks_for_it(own: Path) -> None:
    write(own, "demo/msg/Bad", "int33 x\n")
    write(own, "demo/msg/Good", "int32 x\n")
    write(own, "demo/msg/WithBad", "Bad bad\n")
    (own / "demo" / "msg" / "Binary.msg").write_bytes(b"\xff\xfe")
    assert message_class("demo/msg/Good")().x == 0  # type: ignore[attr-defined]
    assert len(names("msg", "demo")) == 4
    for name in ("demo/msg/Bad", "demo/msg/WithBad"):
        with pytest.raises(ConfigurationError, match=r"demo/msg/Bad\.msg:1: 'int33' is not a known type"):
            message_class(name)
    with pytest.raises(ConfigurationError, match=r"Bad\.msg:1"):
        find_type("demo/Bad")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        find_definition("demo/msg/Binary")


def test_a_definition_that_was_mended_is_read_again(own: Path) -> None:
    write(own, "demo/msg/Wheel", "int33 x\n")
    with pytest.raises(ConfigurationError):
        message_class("demo/msg/Wheel")
    assert make(own, "int32 x 4\n")().x == 4


def test_a_message_within_itself_is_refused(own: Path) -> None:
    write(own, "demo/msg/Egg", "Hen hen\n")
    write(own, "demo/msg/Hen", "Egg[] eggs\n")
    with pytest.raises(ConfigurationError, match="contains itself: demo/msg/Egg -> demo/msg/Hen"):
        message_class("demo/msg/Egg")
    with pytest.raises(ConfigurationError, match="too large"):
        make(own, "float64[2000000000] xs\n")
    with pytest.raises(ConfigurationError, match="too large"):
        rosidl.message_class("demo/msg/Wheel")


def test_a_header_of_the_own_package(own: Path) -> None:
    """`Header` is that of the package; std_msgs has it for packages without one, as in ROS 1."""
    write(own, "demo/srv/Turn", "Header header\n---\nHeader header\n")
    write(own, "other/msg/Wheel", "Header header\n")
    write(own, "demo/msg/Header", "Header header\nint32 size\n")
    assert make(own, "Header header\nstd_msgs/Header std\n")().header.size == 0
    found: Any = message_class
    assert found("demo/msg/Wheel")().std.frame_id == ""
    assert found("demo/srv/Turn_Response")().header.size == 0
    assert found("demo/msg/Header")().header.frame_id == ""
    assert found("other/msg/Wheel")().header.frame_id == ""
    write(own, "other/msg/Rim", "other/Header header\n")
    with pytest.raises(ConfigurationError, match=r"Rim.msg:1: 'Header' is not a known type"):
        message_class("other/msg/Rim")


def test_full_names(own: Path) -> None:
    assert full_name("std_msgs/String") == full_name("std_msgs/msg/String") == "std_msgs/msg/String"
    assert full_name("std_srvs/SetBool") == "std_srvs/srv/SetBool"
    assert full_name("example_interfaces/Fibonacci") == "example_interfaces/action/Fibonacci"
    assert full_name("nope/X") == "nope/msg/X"


def workspace(root: Path, folder: str, package: str, text: str) -> None:
    """Make a package with the message Wheel in a workspace, in a folder with another name."""
    path = root / "src" / folder
    (path / "msg").mkdir(parents=True)
    (path / "package.xml").write_text(f"<package><name>{package}</name></package>")
    (path / "msg" / "Wheel.msg").write_text(text)


def test_a_workspace_is_found_from_within(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "ws"
    workspace(root, "deep/er/folder", "first", "int8 a")
    workspace(root, "second", "second", "first/Wheel[] wheels")
    workspace(root, "ignored", "third", "int8 a")
    (root / "src" / "ignored" / "COLCON_IGNORE").touch()
    assert names(package="first") == []
    for folder in (root, root / "src" / "second" / "msg", root / "install" / "second" / "lib"):
        folder.mkdir(parents=True, exist_ok=True)
        monkeypatch.chdir(folder)
        assert names(package="first") == ["first/msg/Wheel"]
        assert definition_path("second/msg/Wheel") == root / "src" / "second" / "msg" / "Wheel.msg"
        assert names(package="third") == []
    assert type(message_class("second/msg/Wheel")().wheels) is list  # type: ignore[attr-defined]


def test_a_workspace_is_found_around_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace(tmp_path / "ws", "first", "first", "int8 a")
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "ws" / "src" / "first" / "node.py")])
    assert names(package="first") == ["first/msg/Wheel"]


def test_a_package_without_a_workspace_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace(tmp_path / "ws", "first", "first", "int8 a")
    (tmp_path / "ws" / "src" / "first").rename(tmp_path / "alone")
    monkeypatch.chdir(tmp_path / "alone" / "msg")
    assert names(package="first") == ["first/msg/Wheel"]


def test_the_order_of_places(tmp_path: Path, own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def found() -> str:
        return definition_path("turtlesim/msg/Pose").read_text()

    assert found().startswith("# Where a turtle is")
    write(own, "turtlesim/msg/Pose", "int8 own")
    assert found() == "int8 own"
    workspace(tmp_path / "ws", "turtlesim", "turtlesim", "int8 a")
    (tmp_path / "ws" / "src" / "turtlesim" / "msg" / "Pose.msg").write_text("int8 workspace")
    monkeypatch.chdir(tmp_path / "ws")
    assert found() == "int8 workspace"
    write(tmp_path / "prefix" / "share", "turtlesim/msg/Pose", "int8 prefix")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'nowhere'}:{tmp_path / 'prefix'}")
    assert found() == "int8 prefix"
    assert names("msg", "turtlesim") == ["turtlesim/msg/Color", "turtlesim/msg/Pose", "turtlesim/msg/Wheel"]
