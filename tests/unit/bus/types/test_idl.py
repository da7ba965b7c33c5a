"""The language of .msg, .srv and .action files: its meaning, and the texts of errors."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus.types.idl import (
    INTEGERS,
    PRIMITIVES,
    Constant,
    Field,
    Message,
    Type,
    code_of,
    parse_action,
    parse_message,
    parse_service,
)
from rows import for_each


def field(line: str) -> Field:
    (only,) = parse_message(line, "demo/msg/Wheel").fields
    return only


def constant(line: str) -> Any:
    (only,) = parse_message(line, "demo/msg/Wheel").constants
    return only.value


@for_each(
    ("text", "type_"),
    [
        ("int32", Type("int32")),
        ("string", Type("string")),
        ("string<=10", Type("string", 10)),
        ("wstring<=3[2]", Type("wstring", 3, "fixed", 2)),
        ("float64[]", Type("float64", None, "unbounded")),
        ("float64[36]", Type("float64", None, "fixed", 36)),
        ("string<=5[<=3]", Type("string", 5, "bounded", 3)),
        ("Header", Type("std_msgs/msg/Header")),
        ("time", Type("builtin_interfaces/msg/Time")),
        ("duration[]", Type("builtin_interfaces/msg/Duration", None, "unbounded")),
        ("Spoke[4]", Type("demo/msg/Spoke", None, "fixed", 4)),
        ("geometry_msgs/Point", Type("geometry_msgs/msg/Point")),
        ("geometry_msgs/msg/Point[]", Type("geometry_msgs/msg/Point", None, "unbounded")),
    ],
)
def test_types(text: str, type_: Type) -> None:
    assert field(f"{text} x") == Field("x", type_, None, 1)


def test_a_header_of_the_own_package() -> None:
    (own, std) = parse_message("Header[2] own\nstd_msgs/Header std", "demo/msg/Wheel", has_header=True).fields
    assert own.type == Type("demo/msg/Header", None, "fixed", 2)
    assert std.type == Type("std_msgs/msg/Header")


@for_each(
    ("line", "value"),
    [
        ("int32 x 5", 5),
        ("int32 x\t-5 # five", -5),
        ("uint8 x 0x1f", 31),
        ("int16 x -007", -7),
        ("int32[] x [ 01 , 0b11 ]", (1, 3)),
        ("bool x True", True),
        ("bool x 0", False),
        ("float32 x 1", 1.0),
        ("float64 x 1e-3", 0.001),
        ("byte x 7", b"\x07"),
        ("char x 65", 65),
        ('string x "a # b" # c', "a # b"),
        ("string x 'it''s", None),
        (r"string x 'it\'s'", "it's"),
        ("string x plain words # c", "plain words"),
        ("string x it's # c", "it's"),
        ('string x ""', ""),
        ("float64[] x [1.0, 2]", (1.0, 2.0)),
        ("int8[] x []", ()),
        ("int8[<=3] x [1,]", (1,)),
        ("byte[2] x [0, 255]", (b"\x00", b"\xff")),
        ("""string[] x ["a, b", 'c#]', d e]""", ("a, b", "c#]", "d e")),
    ],
)
def test_defaults(line: str, value: Any) -> None:
    if value is None:
        with pytest.raises(ConfigurationError, match="no quoted text"):
            field(line)
    else:
        default = field(line).default
        assert default == value and type(default) is type(value)


@for_each("begin", ["", "1", "1,"])
def test_many_blanks_in_a_list_take_no_time(begin: str) -> None:
    """If parts of a pattern share blanks, the time for this grows with the third power: hours."""
    with pytest.raises(ConfigurationError, match="is no list of values"):
        field(f"int8[] x [{begin}{' ' * 20_000}']")


@for_each(
    ("line", "value"),
    [
        ("int32 X=1", 1),
        ("int32 X = -1", -1),
        ("uint8 X=010", 10),
        ("uint64 X_2 =18446744073709551615", 2**64 - 1),
        ("float32 PI=3.14", 3.14),
        ("byte OK=0", b"\x00"),
        ('string S="a=b"', "a=b"),
        ("string S=plain = words", "plain = words"),
        ("string<=3 S='abc'", "abc"),
    ],
)
def test_constants(line: str, value: Any) -> None:
    assert constant(line) == value


def test_a_whole_message() -> None:
    text = "\ufeff# first\r\n\r\n  int8 LEFT=1\r\nint8 side # which\r\n#int8 gone\r\nSpoke[] spokes"
    assert parse_message(text, "demo/msg/Wheel") == Message(
        "demo/msg/Wheel",
        (
            Field("side", Type("int8"), None, 4),
            Field("spokes", Type("demo/msg/Spoke", None, "unbounded"), None, 6),
        ),
        (Constant("LEFT", Type("int8"), 1),),
    )
    assert parse_message("", "demo/msg/Nothing") == Message("demo/msg/Nothing")


def test_services_and_actions_have_parts() -> None:
    service = parse_service("int8 a\n--- # and back\nint8 a\nWheel wheel", "demo/srv/Turn")
    assert (service.request.name, service.response.name) == (
        "demo/srv/Turn_Request",
        "demo/srv/Turn_Response",
    )
    assert [field.name for field in service.response.fields] == ["a", "wheel"]
    assert service.response.fields[1] == Field("wheel", Type("demo/msg/Wheel"), None, 4)
    assert parse_service("---", "demo/srv/Turn").request.fields == ()
    action = parse_action("int8 a\n---\nint8 b\n---\nint8 c\n", "demo/action/Roll")
    assert [part.name for part in action[1:]] == [
        f"demo/action/Roll_{part}" for part in ("Goal", "Result", "Feedback")
    ]
    assert [part.fields[0].name for part in action[1:]] == ["a", "b", "c"]


@for_each(
    ("line", "what"),
    [
        ("int33 x", "'int33' is not a known type; did you mean 'int32'?"),
        ("INT32 x", None),
        ("flaot64 x", "'flaot64' is not a known type; did you mean 'float64'?"),
        ("a/b/C x", "'a/b/C' is not a known type"),
        ("int32", "'int32' has no name after it"),
        (
            "int32 Xy",
            "'Xy' is no name of a field: they have lower-case letters, digits and single underscores",
        ),
        ("int32 a__b", "'a__b' is no name of a field"),
        ("int32 a_", "'a_' is no name of a field"),
        ("int32 LEFT", "'LEFT' is no name of a field"),
        ("int32 LEFT", "a constant has a value: LEFT=1"),
        ("int32 x=1", "'x' is no name of a constant"),
        ("int32 X=", "constant 'X' has no value"),
        ("int32[] X=1", "a constant has one value of a primitive type, not 'int32[]'"),
        ("Spoke X=1", "a constant has one value of a primitive type, not 'Spoke'"),
        ("int32 x 1.5", "1.5 is no value of type int32"),
        ("uint8 x 300", "300 is no value of type uint8: from 0 to 255"),
        ("int8 X=-129", "-129 is no value of type int8: from -128 to 127"),
        ("bool x yes", "yes is no value of type bool"),
        ("float32 x one", "one is no value of type float32"),
        ('string x "a', '"a is no quoted text'),
        ('string x "a" b', '"a" b is no quoted text'),
        ("string<=2 x abc", "'abc' is longer than 2"),
        ("Spoke x 1", "a field of type 'demo/msg/Spoke' can't have a default (1)"),
        ("int8[] x 1", "the default of an array is in brackets, like [1, 2]; it is 1"),
        ("int8[] x [1 [", "the default of an array is in brackets"),
        ("int8[] x [1,,2]", "[1,,2] is no list of values"),
        ("int8[3] x [1, 2]", "the array has 3 values, its default 2"),
        ("int8[<=1] x [1, 2]", "the array has at most 1 values, its default 2"),
        ("int8[0] x", "'int8[0]': a size is from 1 to 2147483647"),
        ("int8[<=] x", "'int8[<=]' has no number after <="),
        ("int8[-1] x", "'int8[-1]' is no type"),
        ("int8<=3 x", "'int8<=3': only a string has a limit of its own"),
        ("string<= x", "'string<=' is no type"),
        ("---", "one '---' too many: a message has no lines '---'"),
        ("int8 x\nint8 x", "there are two of the name 'x'"),
    ],
)
def test_errors_name_the_line_and_what_is_wrong(line: str, what: str | None) -> None:
    if what is None:
        assert field(line).type.base == "demo/msg/INT32"  # it may be a message; bus.types.definitions decides
        return
    with pytest.raises(ConfigurationError) as caught:
        parse_message(f"# a comment\n{line}\n", "demo/msg/Wheel")
    number = 3 if "\n" in line else 2
    assert str(caught.value).startswith(f"demo/msg/Wheel.msg:{number}: ")
    assert what in str(caught.value)


def test_separators_are_counted() -> None:
    with pytest.raises(ConfigurationError, match=r"Turn\.srv:1: .* a service has 1 line '---', here: 0"):
        parse_service("", "demo/srv/Turn")
    with pytest.raises(ConfigurationError, match=r"Turn\.srv:2: one '---' too many"):
        parse_service("---\n---", "demo/srv/Turn")
    with pytest.raises(ConfigurationError, match=r"an action has 2 lines '---', here: 1"):
        parse_action("int8 a\n---\n", "demo/action/Roll")


@for_each("name", ["Demo/msg/X", "demo/msg/wheel", "demo/srv/Wheel", "Wheel", "a__b/msg/X", ""])
def test_names_of_definitions(name: str) -> None:
    with pytest.raises(ConfigurationError, match=r"a package has|begins with a capital"):
        parse_message("", name)


def test_code_is_a_line_without_its_comment() -> None:
    assert code_of(' string x "#" # b ') == 'string x "#"'
    assert code_of("  # only this") == ""


@given(st.text() | st.text(st.sampled_from("int8 string[]<=3x X=#'\"\\\n-.,/_")))
def test_any_text_is_a_definition_or_an_error(text: str) -> None:
    for parse, name in (
        (parse_message, "demo/msg/X"),
        (parse_service, "demo/srv/X"),
        (parse_action, "demo/action/X"),
    ):
        try:
            parse(text, name)
        except ConfigurationError as error:
            assert str(error).startswith(f"{name}.")


NAMES = st.from_regex(r"[a-z](_?[a-z0-9]){0,6}", fullmatch=True)
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\r\n\\"), max_size=6)


def scalars(base: str) -> st.SearchStrategy[Any]:
    if base == "byte":
        return st.binary(min_size=1, max_size=1)
    if base in INTEGERS:
        return st.integers(*INTEGERS[base])
    if base == "bool":
        return st.booleans()
    return TEXTS if "string" in base else st.floats(allow_nan=False)


@st.composite
def fields(draw: st.DrawFn) -> Field:
    base = draw(st.sampled_from([*sorted(PRIMITIVES), "geometry_msgs/msg/Point", "demo/msg/Spoke"]))
    array = draw(st.sampled_from(["", "fixed", "bounded", "unbounded"]))
    size = draw(st.integers(1, 4)) if array in ("fixed", "bounded") else 0
    bound = draw(st.none() | st.integers(6, 99)) if "string" in base else None
    default = None
    if "/" not in base and draw(st.booleans()):
        least, most = {"fixed": (size, size), "bounded": (0, size)}.get(array, (0, 3))
        many = st.lists(scalars(base), min_size=least, max_size=most).map(tuple)
        default = draw(many if array else scalars(base))
    return Field(draw(NAMES), Type(base, bound, array, size), default)


def written(value: Any) -> str:
    match value:
        case tuple():
            return f"[{', '.join(map(written, value))}]"
        case bytes():
            return str(value[0])
        case str():
            quoted = value.replace('"', r"\"")
            return f'"{quoted}"'
    return str(value)


def line_of(one: Field) -> str:
    base, bound, array, size = one.type
    limit = "" if bound is None else f"<={bound}"
    brackets = {"": "", "fixed": f"[{size}]", "bounded": f"[<={size}]", "unbounded": "[]"}[array]
    default = "" if one.default is None else f" {written(one.default)}"
    return f"{base}{limit}{brackets} {one.name}{default} # {one.name}"


@given(st.lists(fields(), max_size=5, unique_by=lambda one: one.name))
def test_what_is_written_is_read(given_fields: list[Field]) -> None:
    text = "\n".join(map(line_of, given_fields))
    expected = tuple(one._replace(line=at) for at, one in enumerate(given_fields, 1))
    assert parse_message(text, "demo/msg/Wheel").fields == expected
