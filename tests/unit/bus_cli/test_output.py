"""The output functions that all verbs share."""

import ast
import io
import json
import sys
from pathlib import Path

import pytest

import bus_cli
from bus_cli.output import complain, dropped_text, print_json, say, size_text, table
from rows import for_each


@for_each(
    ("size", "text"),
    [
        (0, "0 B"),
        (57.4, "57 B"),
        (999, "999 B"),
        (1000, "1.00 KB"),
        (1500, "1.50 KB"),
        (999_994, "999.99 KB"),
        (1_000_000, "1.00 MB"),
        (2_345_678_901, "2345.68 MB"),
    ],
)
def test_sizes_are_in_thousands(size: float, text: str) -> None:
    assert size_text(size) == text


def test_drops_name_their_reasons() -> None:
    assert dropped_text({}) == "0"
    assert dropped_text({"replaced": 12}) == "12 (replaced: 12)"
    assert dropped_text({"replaced": 12, "expired": 1}) == "13 (expired: 1, replaced: 12)"


def test_json_is_one_line_and_has_no_nan(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"text": "a\nb", "number": float("nan"), "list": [1, 2.5]})
    assert capsys.readouterr().out == '{"text":"a\\nb","number":null,"list":[1,2.5]}\n'


def test_complaints_are_not_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", stderr := io.StringIO())
    complain("x")
    assert stderr.getvalue() == "x\n"


def test_a_table_as_ros2_draws_it() -> None:
    header = ("topic", "rate", "min_delta", "max_delta", "std_dev", "window")
    rows = [
        ("/chatter", "1.000", "0.999", "1.001", "0.00052", "10"),
        ("/a", "10.000", "0.099", "0.101", "0.00052", "100"),
    ]
    assert table(header, rows) == (
        " topic      rate    min_delta   max_delta   std_dev   window\n"
        f"{'=' * 60}\n"
        "/chatter   1.000    0.999       1.001       0.00052   10    \n"
        "/a         10.000   0.099       0.101       0.00052   100   \n"
    )


NASTY = "a\x1b[2J\x9b\u202e\u2028b\r\n\tc"
SHOWN = "a\\x1b[2J\\x9b\\u202e\\u2028b\\r\n\tc"


def test_no_control_character_reaches_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    say(NASTY, 5, sep="|", end="!")
    complain(ValueError(NASTY))
    assert capsys.readouterr() == (f"{SHOWN}|5!", f"{SHOWN}\n")


def test_json_says_it_in_its_own_way(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({NASTY: NASTY})
    text = capsys.readouterr().out
    assert text.isascii() and text[:-1].isprintable()
    assert json.loads(text) == {NASTY: NASTY}


def writes(path: Path) -> list[str]:
    """The calls in a module that write text directly."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.Call(func=ast.Name(id="print")):
                found.append("print()")
            case ast.Attribute(value=ast.Attribute(attr="stdout" | "stderr"), attr="write" | "writelines"):
                found.append(ast.unparse(node))
    return found


def test_verbs_write_by_these_alone() -> None:
    """The only exception is the escape sequence with which `echo -c` clears the screen."""
    folder = Path(bus_cli.__file__).parent
    found = {str(path.relative_to(folder)): writes(path) for path in folder.rglob("*.py")}
    assert {name: what for name, what in found.items() if what} == {
        "output.py": ["print()", "sys.stdout.write", "sys.stdout.write"],
        "topic/echo.py": ["sys.stdout.write", "sys.stdout.write"],
    }
