"""Substitutions: their values, and the errors of those without a value."""

import os
import sys
from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch.conditions import (
    IfCondition,
    UnlessCondition,
)
from bus_launch.launch.core import LaunchContext, Substitution, SubstitutionFailure
from bus_launch.launch.frontend import Parser
from bus_launch.launch.substitutions import (
    AllSubstitution,
    AndSubstitution,
    AnonName,
    AnySubstitution,
    Command,
    EnvironmentVariable,
    EqualsSubstitution,
    FileContent,
    FindExecutable,
    IfElseSubstitution,
    LaunchConfiguration,
    LocalSubstitution,
    NotEqualsSubstitution,
    NotSubstitution,
    OrSubstitution,
    PathJoinSubstitution,
    PathSubstitution,
    PythonExpression,
    StringJoinSubstitution,
    TextSubstitution,
    ThisLaunchFile,
    ThisLaunchFileDir,
)
from launching import perform
from rows import for_each

X = LaunchConfiguration("x")


@for_each(
    ("sub", "value"),
    [
        (TextSubstitution(text="a"), "a"),
        (X, "1"),
        (["<", X, ">"], "<1>"),
        (LaunchConfiguration(["y", "z"], default="none"), "none"),
        (LaunchConfiguration("y", default=["<", X, ">"]), "<1>"),
        (LaunchConfiguration("y", default=5), "5"),
        (PathJoinSubstitution(["a", X, "b.py"]), "a/1/b.py"),
        (PathJoinSubstitution(["a", ["b", X]]), "a/b1"),
        (PathSubstitution("a") / "b" / X, "a/b/1"),
        (StringJoinSubstitution(["a", X], delimiter="-"), "a-1"),
        (NotSubstitution("True"), "false"),
        (AndSubstitution(X, "0"), "false"),
        (OrSubstitution("false", X), "true"),
        (AnySubstitution("false", "0"), "false"),
        (AllSubstitution("true", X), "true"),
        (EqualsSubstitution(X, "true"), "true"),
        (EqualsSubstitution(X, 1.0), "true"),
        (EqualsSubstitution("a", "A"), "false"),
        (NotEqualsSubstitution("a", "b"), "true"),
        (IfElseSubstitution(X, "yes", "no"), "yes"),
        (IfElseSubstitution("false", "yes", ["n", "o"]), "no"),
        (IfElseSubstitution("off", else_value="no"), "no"),
        (NotSubstitution("yes"), "false"),
        (EqualsSubstitution(None, ""), "true"),
        (PythonExpression(["'", X, "' == '1'"]), "True"),
        (PythonExpression(["pi > ", X, " and math.pi > 3"]), "True"),
        (PythonExpression("os.sep", ["os"]), os.sep),
        (EnvironmentVariable("HOME_OF_NOBODY", default_value="x"), "x"),
        (EnvironmentVariable("PATH"), os.environ["PATH"]),
        (FindExecutable(name="sh"), "/bin/sh"),
        (Command("echo a 'b c'"), "a b c\n"),
        (Command(["echo ", X], on_stderr="ignore"), "1\n"),
    ],
)
def test_values(sub: Any, value: str) -> None:
    assert perform(sub, x="1").replace("/usr/bin/sh", "/bin/sh") == value


def test_expressions() -> None:
    assert PythonExpression("1", ["os", "math"]).describe() == "PythonExpr('1', ['os', 'math'])"
    for modules in ([], [""], ["os"]):
        with pytest.raises(NameError, match=r"the expression 'math.pi' failed: NameError"):
            perform(PythonExpression("math.pi", modules))


def test_a_choice_needs_a_value() -> None:
    with pytest.raises(RuntimeError, match="One of if_value and else_value must be specified"):
        IfElseSubstitution("true")


@for_each(
    ("sub", "problem"),
    [
        (LaunchConfiguration("sped"), "launch configuration 'sped' does not exist; did you mean 'speed'"),
        (EnvironmentVariable("NOBODYS"), "environment variable 'NOBODYS' does not exist"),
        (FindExecutable(name="nosuchprogram"), "executable 'nosuchprogram' not found on the PATH"),
        (FileContent("/nosuchfile"), "File not found: /nosuchfile"),
        (FileContent("/"), "Failed to open file '/'"),
        (Command("nosuchprogram"), "file not found"),
        (Command("false"), "executed command failed. Command: false"),
        (Command("sh -c 'echo oh >&2'"), "executed command showed stderr output(.|\n)*oh"),
        (Command("true", on_stderr="cry"), "expected 'on_stderr' to be one of"),
        (Command("echo 'a"), "No closing quotation"),
        (PythonExpression("1 +"), r"the expression '1 \+' failed: SyntaxError"),
        (NotSubstitution("maybe"), "Expression 'maybe' is not one of the valid true expressions"),
        (ThisLaunchFile(), "ThisLaunchFile used outside of a launch file"),
        (ThisLaunchFileDir(), "ThisLaunchFileDir used outside of a launch file"),
    ],
)
def test_why_there_is_no_value(sub: Any, problem: str) -> None:
    with pytest.raises(SubstitutionFailure, match=problem):
        perform(sub, speed="1")


def test_a_circle_is_said() -> None:
    class Circle(Substitution):
        def perform(self, context: LaunchContext) -> str:
            return context.perform_substitution(self)

    with pytest.raises(SubstitutionFailure, match="substitutions go round in a circle, at a Circle"):
        perform(Circle())


def test_a_name_for_one_launch() -> None:
    context = LaunchContext()
    name = AnonName("node").perform(context)
    assert name.startswith("node_")
    assert AnonName("node").perform(context) == name != AnonName("other").perform(context)
    assert AnonName("node").perform(LaunchContext()) != name


def test_what_an_event_brought() -> None:
    context = LaunchContext()
    context.extend_locals({"event": sys})
    assert LocalSubstitution("event.byteorder").perform(context) == sys.byteorder


def test_a_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("text\n")
    assert perform(FileContent(str(tmp_path / "a"))) == "text\n"


@for_each(
    ("text", "value"),
    [
        ("$(var x)", "1"),
        ("$(var y none)", "none"),
        ("$(env NOBODYS x)", "x"),
        ("$(eval '$(var x) + 1')", "2"),
        ("$(equals $(var x) 1)", "true"),
        ("$(not-equals $(var x) 1)", "false"),
        ("$(not $(or false $(and true $(var x))))", "false"),
        ("$(any false true) $(all false true)", "true false"),
        ("$(if $(var x) a b)", "a"),
        ("$(command 'echo a')", "a\n"),
        ("$(find-exec nosuch)", "error"),
        ("$(find-pkg-share nosuchpackage)", "error"),
    ],
)
def test_in_markup(text: str, value: str) -> None:
    try:
        found = perform(Parser().parse_substitution(text), x="1")
    except SubstitutionFailure:
        found = "error"
    assert found == value


@for_each(
    ("text", "problem"),
    [
        ("$(vra x)", "Unknown substitution: vra; did you mean 'var'"),
        ("$(var)", "var substitution expects 1 to 2 arguments, got 0"),
        ("$(dirname x)", "dirname substitution expects 0 arguments, got 1"),
    ],
)
def test_mistakes_in_markup(text: str, problem: str) -> None:
    with pytest.raises((RuntimeError, TypeError), match=problem):
        Parser().parse_substitution(text)


@for_each(
    ("condition", "value"),
    [
        (IfCondition(X), True),
        (IfCondition(" True "), True),
        (UnlessCondition("1"), False),
        (UnlessCondition(PythonExpression("1 > 2")), True),
    ],
)
def test_conditions(condition: Any, value: bool) -> None:
    context = LaunchContext()
    context.launch_configurations["x"] = "1"
    assert condition.evaluate(context) is value
