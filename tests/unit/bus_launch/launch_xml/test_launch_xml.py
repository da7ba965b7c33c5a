"""Launch files of XML or YAML: attributes, and errors, each in one line that names the error."""

import io
from pathlib import Path
from typing import List  # noqa: UP035 (a launch file's `data_type`)

import pytest

from bus_launch.launch.actions import ExecuteProcess, Shutdown, TimerAction
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.errors import InvalidLaunchFileError
from bus_launch.launch.launch_description_sources import get_launch_description_from_any_launch_file
from bus_launch.launch_xml import Parser
from rows import for_each

_LAUGHS = "a: &a [x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(10 * ['*' + before])}]\n"
    for before, name in zip("abcdef", "bcdefg", strict=True)
)


@for_each(
    ("text", "problem"),
    [
        (
            '<launch><nod pkg="a" exec="b"/></launch>',
            "Unrecognized entity of the type: nod; did you mean 'node'?",
        ),
        (
            '<launch><node pkg="a" exec="b" nmae="c"/></launch>',
            "Unexpected attribute(s) found in `node`: {'nmae'}; did you mean 'name'?",
        ),
        (
            '<launch><node pkg="a" exec="b"><parm name="a" value="b"/></node></launch>',
            "Unexpected nested tag(s) found in `node`: {'parm'}; did you mean 'param'?",
        ),
        (
            '<launch><node exec="b"><remap from="a" to="b" x="c"/></node></launch>',
            "Unexpected attribute(s) found in `remap`: {'x'}",
        ),
        ('<launch><node pkg="a"/></launch>', "Attribute 'exec' of type 'str' not found in Entity 'node'"),
        (
            '<launch><group scoped="maybe"/></launch>',
            "Attribute 'scoped' of Entity 'group' expected to be of type 'bool'. 'maybe' can not be",
        ),
        (
            '<launch><node exec="b" respawn_delay="-1"/></launch>',
            "expected to be a non-negative value but got",
        ),
        (
            '<launch><node exec="b"><param value="1"/></node></launch>',
            "param Entity should have name or from",
        ),
        (
            '<launch><node exec="b"><param name="a"/></node></launch>',
            "either a value attribute or nested params",
        ),
        (
            '<launch><node exec="b"><param name="a" value="1" type="number"/></node></launch>',
            "param 'a': type 'number' is none of bool, int, float, str",
        ),
        ('<launch><log message="$(var x"/></launch>', "'$(var x' is not closed by ')'"),
        ("<launch>text</launch>", "Unexpected text found in `launch`: 'text'"),
        (
            '<launch><log message="a" if="1" unless="0"/></launch>',
            "if and unless conditions can't be used sim",
        ),
        ('<launch><executable cmd="ls" on_exit="x"/></launch>', "expected to be `shutdown` but got `x`"),
        ("<lunch/>", "Expected 'launch' as root tag"),
        ("<launch>", "ParseError: no element found: line 1, column 8"),
        (
            "<launch><load_composable_node><composable_node/></load_composable_node></launch>",
            "Attribute 'target' of type 'str' not found in Entity 'load_composable_node'",
        ),
        ("launch: [node: {pkg: a, exec: b, foo: 1}]", "Unexpected key(s) found in `node`: {'foo'}"),
        (
            "launch: [log: {message: [1]}]",
            "Attribute 'message' of Entity 'log' expected to be of type 'str', got",
        ),
        ("launch: [node: {exec: b, param: {a: 1}}]", "expected to be a list of dictionaries"),
        ("launch: [{a: 1, b: 2}]", "Expected a len 1 dictionary, got {'a': 1, 'b': 2}"),
        ("launch: {a: 1}", "Expected entity `launch` to have children entities"),
        ("launch: 5", "Expected a list of what is in `launch`, got 5"),
        ("launch: [node: [a", "expected ',' or ']', but got '<stream end>': line 1, column 18"),
        ("", "Expected a len 1 dictionary, got None"),
        ("launch: &a [group: *a]", "an alias is used inside what it stands for"),
        (_LAUGHS, "more than 100,000 values, once its aliases are filled in"),
        (
            f"""<launch><log message="{"$(var " * 1000}"/></launch>""",
            "more than 50 substitutions inside each other in '$(var $(var $(var",
        ),
    ],
)
def test_mistakes(text: str, problem: str, tmp_path: Path) -> None:
    kind = "xml" if text.startswith("<") else "yaml"
    path = tmp_path / f"bad.launch.{kind}"
    path.write_text(text)
    with pytest.raises(InvalidLaunchFileError) as caught:
        get_launch_description_from_any_launch_file(str(path))
    said = str(caught.value)
    assert said.startswith(f"Caught exception when trying to load file of format [{kind}]: ")
    assert problem in said
    assert said.endswith(f" (bad.launch.{kind})")
    assert "\n" not in said


@for_each(
    "text",
    [
        """<launch>
          <timer period="5"><executable cmd="ls" on_exit="shutdown"/></timer>
          <let name="a" value="1"/><let name="b" value="2"/>
          <reset><keep name="b" value="$(var b)"/></reset>
        </launch>""",
        """launch:
        - timer: {period: 5, children: [executable: {cmd: ls, on_exit: shutdown}]}
        - let: {name: a, value: '1'}
        - let: {name: b, value: '2'}
        - reset: {keep: [{name: b, value: $(var b)}]}""",
    ],
)
def test_attributes_of_jazzy(text: str, tmp_path: Path) -> None:
    path = tmp_path / ("a.xml" if text.startswith("<") else "a.yaml")
    path.write_text(text)
    timer, *others = get_launch_description_from_any_launch_file(str(path)).entities
    assert isinstance(timer, TimerAction) and timer.period == 5.0
    (process,) = timer.actions
    assert isinstance(process, ExecuteProcess)
    assert [type(one) for one in process.get_sub_entities()] == [Shutdown]
    context = LaunchContext()
    for one in others:
        one.visit(context)
    assert context.launch_configurations == {"b": "2"}


def test_lists_in_xml() -> None:
    tag = Parser.load(io.StringIO('<a><b c="1,2" c-sep=","/></a>'))[0].children[0]
    for kind, value in ((str, ["1", "2"]), (int, [1, 2]), (float, [1.0, 2.0])):
        assert tag.get_attr("c", data_type=List[kind]) == value  # type: ignore[valid-type]  # noqa: UP006
    assert tag.get_attr("c", data_type=None) == [1, 2]


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    for path in (tmp_path / "bad.launch.xml", tmp_path / "bad.launch.yaml"):
        path.write_bytes(b"<launch>\xff</launch>")
        with pytest.raises(InvalidLaunchFileError) as caught:
            get_launch_description_from_any_launch_file(str(path))
        assert f"can't decode byte 0xff in position 8: invalid start byte ({path.name})" in str(caught.value)


def test_a_file_of_any_name(tmp_path: Path) -> None:
    """The reader tries all formats."""
    (tmp_path / "a").write_text("<launch/>")
    assert get_launch_description_from_any_launch_file(str(tmp_path / "a")).entities == []
    (tmp_path / "b").write_text("what")
    with pytest.raises(InvalidLaunchFileError) as caught:
        get_launch_description_from_any_launch_file(str(tmp_path / "b"))
    first, *others = str(caught.value).splitlines()
    assert first == "Caught multiple exceptions when trying to load file:"
    assert others == [
        " - NameError: name 'what' is not defined (b)",
        " - ParseError: syntax error: line 1, column 0 (b)",
        " - Expected a len 1 dictionary, got 'what' (b)",
    ]


@for_each(
    ("text", "problem"),
    [
        ("def generate_launch_description(:", "invalid syntax (bad.launch.py, line 1)"),
        ("x = 1", "does not contain the required function 'generate_launch_description()'"),
        ("def generate_launch_description(): pass", "generate_launch_description() returned None"),
        (
            "def generate_launch_description():\n    return nobody",
            "NameError: name 'nobody' is not defined (bad.launch.py, line 2)",
        ),
        (
            "def generate_launch_description(): return []",
            "generate_launch_description() returned no LaunchDescription, but []",
        ),
        (
            "import nosuchmodule",
            "ModuleNotFoundError: No module named 'nosuchmodule' (bad.launch.py, line 1)",
        ),
    ],
)
def test_mistakes_in_python(text: str, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.launch.py"
    path.write_text(text)
    with pytest.raises(InvalidLaunchFileError) as caught:
        get_launch_description_from_any_launch_file(str(path))
    assert problem in str(caught.value)
