"""Definitions as values: whole messages, services and actions, with comments."""

from pathlib import Path
from typing import Any

import pytest

import bus
from bus_ros.rosidl_adapter import parser
from rows import for_each

SHARE = Path(str(bus.__file__)).parent / "share"
TEXT = """# The wheel of a robot.
#
#   indented

# How fast it turns [rad/s]
float64 speed 1.5  # never negative

   # the second line

uint8 LEFT=0
string<=10[] names ["a,b", 'c']
std_msgs/Header header
Point32[<=3] points
"""


def test_a_message() -> None:
    message = parser.parse_message_string("my_msgs", "Wheel", TEXT)
    assert str(message.base_type) == "my_msgs/Wheel" and message.msg_name == "Wheel"
    assert message.annotations["comment"] == ["The wheel of a robot.", "", "  indented"]
    speed, names, header, points = message.fields
    assert (str(speed.type), speed.name, speed.default_value) == ("float64", "speed", 1.5)
    assert speed.annotations == {
        "comment": ["How fast it turns", "never negative", "the second line"],
        "unit": "rad/s",
    }
    assert names.default_value == ["a,b", "c"]
    assert (header.type.pkg_name, header.type.type) == ("std_msgs", "Header")
    assert (points.type.pkg_name, points.type.type, points.type.array_size) == ("my_msgs", "Point32", 3)
    (left,) = message.constants
    assert (left.type, left.name, left.value, left.annotations) == ("uint8", "LEFT", 0, {"comment": []})
    assert str(message).splitlines() == [
        "# my_msgs/Wheel",
        "uint8 LEFT=0",
        "float64 speed 1.5",
        "string<=10[] names ['a,b', 'c']",
        "std_msgs/Header header",
        "my_msgs/Point32[<=3] points",
    ]
    again = parser.parse_message_string("my_msgs", "Wheel", TEXT)
    assert again == message
    again.fields[0].default_value = 2.0
    assert again != message


def test_a_service_and_an_action(tmp_path: Path) -> None:
    service = parser.parse_service_string("my_msgs", "Turn", "float64 angle\n---\nbool ok\n")
    assert [field.name for field in service.request.fields] == ["angle"]
    assert service.response.msg_name == "Turn_Response"
    assert str(service).splitlines()[3:] == ["---", "# my_msgs/Turn_Response", "bool ok"]
    action = parser.parse_action_string("my_msgs", "Go", "int32 a\n---\nint32 b\n---\nint32 c")
    parts = action.goal, action.result, action.feedback
    assert [(part.msg_name, part.fields[0].name) for part in parts] == [
        ("Go_Goal", "a"),
        ("Go_Result", "b"),
        ("Go_Feedback", "c"),
    ]


KNOWN = [parser.BaseType(f"{one.parents[1].name}/{one.stem}") for one in SHARE.glob("*/msg/*.msg")]


@for_each("path", sorted(SHARE.glob("*/*/*.*")))
def test_definitions_of_busd(path: Path) -> None:
    readers: dict[str, Any] = {
        "msg": parser.parse_message_file,
        "srv": parser.parse_service_file,
        "action": parser.parse_action_file,
    }
    if (kind := path.parent.name) in readers:
        found = readers[kind](path.parents[1].name, str(path))
        parser.validate_field_types(found, KNOWN)


@for_each(
    ("line", "kind", "text"),
    [
        ("int32", parser.InvalidFieldDefinition, "int32"),
        ("int32 X", NameError, "'X' is an invalid field name. It should have the pattern"),
        ("int32 x=5", NameError, "'x' is an invalid constant name. It should have the pattern"),
        ("int32 x\nint32 x", ValueError, "the fields iterable contains duplicate names: x"),
        ("int32 A=1\nint32 A=1", ValueError, "the constants iterable contains duplicate names: A"),
        ("foo f", parser.InvalidResourceName, "'foo' is an invalid message name."),
        ("X/Foo f", parser.InvalidResourceName, "'X' is an invalid package name."),
        ("std_msgs/msg/Header h", parser.InvalidResourceName, "std_msgs/msg/Header"),
        ("Foo X=1", TypeError, "the constant type 'Foo' must be a primitive type"),
        ("Foo f 1", NotImplementedError, "parsing string values into type 'pkg/Foo' is not supported"),
    ],
)
def test_malformed_lines(line: str, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind) as caught:
        parser.parse_message_string("pkg", "Msg", line)
    assert str(caught.value).startswith(text)


def test_the_line_with_an_error_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(NameError):
        parser.parse_message_string("pkg", "Msg", "int32 ok\nint32 Bad")
    assert capsys.readouterr().err.startswith(
        "Error processing 'int32 Bad' of 'pkg/Msg': ''Bad' is an invalid"
    )


@for_each("text", ["int32 x", "---\n---"])
def test_parts_of_a_service(text: str) -> None:
    with pytest.raises(parser.InvalidServiceSpecification, match="separator '---' between request and"):
        parser.parse_service_string("pkg", "Srv", text)


@for_each("text", ["int32 x", "---", "---\n---\n---"])
def test_parts_of_an_action(text: str) -> None:
    with pytest.raises(parser.InvalidActionSpecification, match="Number of '---' separators"):
        parser.parse_action_string("pkg", "Act", text)


def test_unknown_types() -> None:
    message = parser.parse_message_string("pkg", "Msg", "Foo[3] f\nint32 x")
    parser.validate_field_types(message, {parser.BaseType("pkg/Foo")})
    with pytest.raises(
        parser.UnknownMessageType, match=r"'pkg/Foo' contains an unknown field type: pkg/Foo\["
    ):
        parser.validate_field_types(message, set())


def test_types() -> None:
    bounded = parser.Type("string<=5[<=3]")
    assert (bounded.type, bounded.string_upper_bound, bounded.array_size) == ("string", 5, 3)
    assert bounded.is_dynamic_array() and not bounded.is_fixed_size_array()
    assert parser.Type("int8[2]").is_fixed_size_array()
    assert str(bounded) == "string<=5[<=3]" and bounded == parser.Type(str(bounded))
    assert bounded != parser.Type("string<=5[3]") and hash(bounded) == hash(parser.Type(str(bounded)))
    assert parser.BaseType("Foo", "pkg") == parser.BaseType("pkg/Foo") != parser.BaseType("int8")
    for wrong in ("int8[0]", "int8[x]", "int8]", "string<=0", "string<=x"):
        with pytest.raises(TypeError):
            parser.Type(wrong)


def test_names() -> None:
    assert parser.is_valid_package_name("my_msgs") and not parser.is_valid_package_name("My")
    assert parser.is_valid_field_name("a_1") and not parser.is_valid_field_name("a__1")
    assert parser.is_valid_message_name("Sample_Foo_Request") and not parser.is_valid_message_name("foo")
    assert parser.is_valid_constant_name("A_1") and not parser.is_valid_constant_name("A_")
    checks: list[Any] = [parser.is_valid_package_name, parser.is_valid_message_name]
    for check in checks:
        with pytest.raises(parser.InvalidResourceName):
            check(None)
