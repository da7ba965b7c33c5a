"""bus_launch.launch_testing.text: the places of expected texts and lines."""

import re
from typing import Any

import pytest

from bus_launch.launch_testing.text import build_line_match, build_text_match, without_escapes
from rows import for_each

TEXT = "one\r\ntwo\nthree"
LINES = ["one", "two", "three"]


@for_each(
    ("expected", "is_strict", "span"),
    [
        ("two", False, (4, 7)),
        ("two", True, None),
        ("one\ntwo\nthree", True, (0, 13)),
        (re.compile("t.o"), False, (4, 7)),
        (re.compile("t.o"), True, None),
        (re.compile("o.e"), True, (0, 3)),
        (["one", re.compile("th")], False, (0, 10)),
        (["one", "\nt"], True, (0, 5)),
        (["one", "two"], True, None),
        (["two", "one"], False, None),
        ([], False, (0, 0)),
    ],
)
def test_texts(expected: Any, is_strict: bool, span: tuple[int, int] | None) -> None:
    assert build_text_match(expected, strict=is_strict)(TEXT) == span


def test_a_text_from_a_place_on() -> None:
    assert build_text_match("o")("one two", 1) == (6, 7)


@for_each(
    ("expected", "is_strict", "span"),
    [
        ("w", False, (1, 2)),
        ("w", True, None),
        (re.compile("t"), False, (1, 2)),
        (re.compile("wo"), False, None),
        (re.compile("[ot]"), True, (0, 3)),
        (["ne", "ee"], False, (0, 3)),
        (["ne", "ee"], True, None),
        (["ne", "wo"], True, (0, 2)),
        (["wo", "ee"], True, None),
        (["two", "one"], False, None),
    ],
)
def test_lines(expected: Any, is_strict: bool, span: tuple[int, int] | None) -> None:
    assert build_line_match(expected, strict=is_strict)(LINES) == span


def test_other_expectations() -> None:
    for build in (build_text_match, build_line_match):
        with pytest.raises(ValueError, match="Unknown format for expected output"):
            build(5)


def test_escape_sequences() -> None:
    assert without_escapes("\x1b[1;31mred\x1b[0m \x1b[Kend") == "red end"
