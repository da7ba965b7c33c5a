"""Parameters as text: the meaning of values, the layout of files, and the nodes of a section."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus.parameters.file import (
    Section,
    load,
    overrides,
    parse_file,
    parse_scalar,
    parse_typed,
    parse_value,
    read_file,
)
from bus.process.ros_args import Arguments
from rows import for_each

VALUES: dict[str, Any] = {
    "true": True,
    "False": False,
    "on": True,
    "off": False,
    "y": True,
    "N": False,
    "0": 0,
    "42": 42,
    "-42": -42,
    "+7": 7,
    "0x10": 16,
    "-0x10": -16,
    "010": 8,
    "08": 8.0,
    "9223372036854775807": 2**63 - 1,
    "9223372036854775808": 2.0**63,
    "1.5": 1.5,
    "-1.5": -1.5,
    "1.": 1.0,
    ".5": 0.5,
    "1e3": 1000.0,
    "1E-2": 0.01,
    ".inf": math.inf,
    "-.inf": -math.inf,
    "abc": "abc",
    "/scan": "/scan",
    "a b": "a b",
    "1_000": "1_000",
    "2024-01-01": "2024-01-01",
    "1:30": "1:30",
    "'42'": "42",
    '"true"': "true",
    "''": "",
    "null": "null",
    "~": "~",
    "!!null x": "x",
    "[a, ~]": ["a", "~"],
    "!!str off": "off",
    "!!str 1e3": "1e3",
    "!!int '7'": 7,
    "[]": [],
    "[1, 2]": [1, 2],
    "[1, 2.5]": [1.0, 2.5],
    "[a, '1']": ["a", "1"],
    "[true, off]": [True, False],
}


@for_each("text", VALUES)
def test_values(text: str) -> None:
    value = parse_value(text)
    assert value == VALUES[text]
    assert type(value) is type(VALUES[text])
    if isinstance(value, list):
        assert [type(item) for item in value] == [type(item) for item in VALUES[text]]


def test_not_a_number() -> None:
    value = parse_value(".nan")
    assert isinstance(value, float)
    assert math.isnan(value)


NO_VALUES = {
    "": "there is no value",
    "{a: 1}": "a parameter's value can't be a mapping",
    "[[1]]": "a list must hold plain values, no lists and no mappings",
    "[1, a]": "a list must hold values of one type, not int and str",
    "[true, 1]": "a list must hold values of one type, not bool and int",
    "[1, ~]": "a list must hold values of one type, not int and str",
    "!!int ''": "there is no value",
    "!!binary aGk=": "the tag 'tag:yaml.org,2002:binary' is not known",
    "!!python/object/apply:os.getcwd []": "the tag ",
    "[&a 1, *a]": "aliases are not supported",
    "[1": "expected ',' or ']'",
    "[" * 5000: "nested too deeply",
}


@for_each("text", NO_VALUES)
def test_no_values(text: str) -> None:
    if "python" in text:
        # The parser ignores the tag of a list, and makes no object of it.
        assert parse_value(text) == []
        return
    with pytest.raises(ConfigurationError) as caught:
        parse_value(text)
    assert NO_VALUES[text] in str(caught.value)


@given(st.text(max_size=60))
def test_any_text_is_a_value_or_an_error(text: str) -> None:
    try:
        value = parse_value(text)
    except ConfigurationError:
        assert parse_typed(text) == text
        return
    assert isinstance(value, bool | int | float | str | list)
    assert parse_typed(text) == value or text in ("y", "Y", "n", "N") or value != value


@given(st.text(max_size=40, alphabet="0123456789+-._eExXaAfFn"))
def test_a_scalar_has_one_meaning(text: str) -> None:
    """The meaning is the same for a value alone and for an item of a list in YAML."""
    alone = parse_scalar(text)
    try:
        (listed,) = parse_value(f"[{text}]")  # type: ignore[str-unpack]
    except (ConfigurationError, ValueError):
        return
    assert repr(listed) == repr(alone)


def test_what_a_user_types_at_a_tool() -> None:
    assert parse_typed("y") == "y"
    assert parse_typed("yes") is True
    assert parse_typed("{a: 1}") == "{a: 1}"
    assert parse_typed("[1, a]") == "[1, a]"
    assert parse_typed("null") == "null"
    assert parse_typed("5") == 5


FILE = """\
/**:
  ros__parameters:
    speed: 1.0
    use_sim_time: false
/robot/wheels:
  ros__parameters:
    speed: 2.0
    left: {gain: 3, names: [a, b]}
robot:
  arm:
    ros__parameters: {speed: 4.0}
  /hand:
    ros__parameters:
"""


def test_file() -> None:
    assert parse_file(FILE, "f.yaml") == [
        Section("/**", {"speed": 1.0, "use_sim_time": False}),
        Section("/robot/wheels", {"speed": 2.0, "left.gain": 3, "left.names": ["a", "b"]}),
        Section("/robot/arm", {"speed": 4.0}),
        Section("/robot/hand", {}),
    ]


def test_what_a_node_gets() -> None:
    sections = parse_file(FILE, "f.yaml")
    assert overrides(sections, "/robot/arm") == {"speed": 4.0, "use_sim_time": False}
    assert overrides(sections, "/robot/hand") == {"speed": 1.0, "use_sim_time": False}
    assert overrides(sections, "/arm")["speed"] == 1.0
    assert overrides(sections, "/robot/wheels")["left.gain"] == 3


def test_the_later_one_holds() -> None:
    sections = [Section("/a", {"x": 1}), Section("/**", {"x": 2}), Section("/b", {"x": 3})]
    assert overrides(sections, "/a") == {"x": 2}
    assert overrides(sections, "/b") == {"x": 3}
    assert overrides(sections[::-1], "/a") == {"x": 1}


PATTERNS = {
    "/**": ({"/a", "/a/b", "/a/b/c"}, set()),
    "/*": ({"/a"}, {"/a/b"}),
    "/*/b": ({"/a/b"}, {"/b", "/a/c/b", "/a/b/c"}),
    "/**/b": ({"/b", "/a/b", "/a/c/b"}, {"/a/bb", "/b/a"}),
    "/a/**": ({"/a", "/a/b", "/a/b/c"}, {"/ab", "/b/a"}),
    "/a/**/c": ({"/a/c", "/a/b/c"}, {"/a/b", "/c"}),
    "/a": ({"/a"}, {"/a/b", "/b/a", "/aa"}),
    "a": ({"/a"}, {"/b/a"}),
    "**": ({"/a", "/a/b"}, set()),
    "/a.b": (set(), {"/a/b", "/aXb"}),
}


@for_each("pattern", PATTERNS)
def test_patterns(pattern: str) -> None:
    fitting, others = PATTERNS[pattern]
    section = Section(pattern, {})
    assert {name for name in fitting | others if section.is_for(name)} == fitting


def test_empty_files() -> None:
    assert parse_file("", "f") == []
    assert parse_file("# nothing\n", "f") == []
    assert parse_file("/a:\n  ros__parameters: {}\n", "f") == [Section("/a", {})]


BROKEN = {
    "a: 1\n": "f:1: 'a' has a value, but stands before ros__parameters",
    "/a:\n  b: [1]\n": "f:2: 'b' has a value, but stands before ros__parameters",
    "ros__parameters: {a: 1}\n": "f:1: no name of a node stands before ros__parameters",
    "- 1\n": "f:1: a mapping (name: value) was expected",
    "/a:\n  ros__parameters:\n    x: 1\n    y: [[1]]\n": "f:4: parameter 'y': a list must hold plain values",
    "/a:\n  ros__parameters:\n    b:\n      c:\n": "f:4: parameter 'b.c': there is no value",
    "/a:\n  ros__parameters:\n    [1, 2]: 3\n": "f:3: a name must be a text",
    "/a:\n  ros__parameters: 5\n": "f:2: a mapping (name: value) was expected",
    "/a: &x {ros__parameters: {b: 1}}\n/c: *x\n": "f:2: aliases are not supported",
    "/a:\n\tb: 1\n": "f:2: found character '\\t' that cannot start any token",
    "---\na: 1\n---\nb: 1\n": "f:3: but found another document",
}


@for_each("text", BROKEN)
def test_broken_files(text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_file(text, "f")
    assert str(caught.value).startswith(BROKEN[text])


@given(st.text(max_size=200, alphabet="ab/*:{}[]&!'\"- \n\t#,1.ros__parameters"))
def test_any_file_is_read_or_an_error(text: str) -> None:
    try:
        sections = parse_file(text, "f")
    except ConfigurationError as error:
        assert str(error).startswith("f:")
        return
    for section in sections:
        overrides([section], "/a/b")


def test_read_file(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text("/a: {ros__parameters: {text: ä}}\n", encoding="utf-8")
    assert read_file(path) == [Section("/a", {"text": "ä"})]
    path.write_bytes(b"/a: \xff")
    with pytest.raises(ConfigurationError, match="is not UTF-8 text"):
        read_file(path)
    with pytest.raises(ConfigurationError, match=r"cannot read '.*nosuch': No such file"):
        read_file(tmp_path / "nosuch")


def given_by(*words: str) -> tuple[Section, ...]:
    return load(Arguments.parse(["--ros-args", *words]).parameters)


def test_command_line(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_text(FILE)
    sections = given_by(
        "-p", "speed:=9", "--params-file", str(path), "-p", "arm:speed:=[1, 2]", "-p", "x:=a b"
    )
    assert overrides(sections, "/robot/arm") == {"speed": [1, 2], "use_sim_time": False, "x": "a b"}
    assert overrides(sections, "/other/arm")["speed"] == [1, 2]
    assert overrides(sections, "/other")["speed"] == 1.0
    assert load(()) == ()


def test_a_section_has_the_place_of_its_first_appearance(tmp_path: Path) -> None:
    """Like rcl: `-p` for every node overrides a file for every node, and not its section for one node."""
    path = tmp_path / "f.yaml"
    path.write_text("/**: {ros__parameters: {x: 1, y: 1}}\narm: {ros__parameters: {x: 2}}\n")
    sections = given_by("--params-file", str(path), "-p", "x:=3", "-p", "y:=3")
    assert [section.pattern for section in sections] == ["/**", "/arm"]
    assert overrides(sections, "/arm") == {"x": 2, "y": 3}
    assert overrides(sections, "/leg") == {"x": 3, "y": 3}
    path.write_text("arm: {ros__parameters: {x: 2}}\n")
    assert overrides(given_by("--params-file", str(path), "-p", "x:=3"), "/arm") == {"x": 3}


def test_broken_command_lines(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        given_by("-p", "node:x:=[1")
    assert str(caught.value).startswith("Couldn't parse parameter override rule: '-p node:x:=[1'. Error: ")
    path = tmp_path / "nosuch.yaml"
    with pytest.raises(ConfigurationError) as caught:
        given_by("--params-file", str(path))
    assert str(caught.value) == (
        f"Couldn't parse params file: '--params-file {path}'. "
        f"Error: cannot read '{path}': No such file or directory"
    )


@for_each("stars", [1, 2, 12])
def test_stars_that_follow_one_another_are_one(stars: int) -> None:
    """Otherwise, each further pattern would multiply the time of a search that finds no match."""
    section = parse_file(f"{'/**' * stars}/b:\n  ros__parameters: {{x: 1}}", "f")[0]
    assert section.is_for("/a" * 30 + "/b")
    assert section.is_for("/b")
    assert not section.is_for("/a" * 30)
