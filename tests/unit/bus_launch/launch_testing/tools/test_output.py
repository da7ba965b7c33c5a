"""bus_launch.launch_testing.tools.output: filters of output, expectations in files, comparisons."""

import re
from pathlib import Path

import pytest

from bus_launch.launch_testing.tools import basic_output_filter, expect_output, expected_output_from_file


def test_filters_leave_lines_out() -> None:
    assert basic_output_filter()("pid 5\nhi\nrc: 0\nho") == "hi\nho"
    assert basic_output_filter(["h"], [".*5"])("pid 5\nhi\nrc: 0\nho") == "rc: 0\n"


def test_expected_output_from_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("one\ntwo\n")
    (tmp_path / "b.regex").write_text("o.e\n")
    assert expected_output_from_file(str(tmp_path / "a")) == ["one", "two"]
    assert expected_output_from_file(str(tmp_path / "b")) == [re.compile("o.e")]
    with pytest.raises(RuntimeError, match=r"could not find output check file: .*/c"):
        expected_output_from_file(str(tmp_path / "c"))


def test_comparisons() -> None:
    assert expect_output("a\nb\nc", expected_lines=["a", "c"])
    assert not expect_output("a\nb\nc", expected_lines=["a", "c"], strict=True)
    assert expect_output(lines=["a", "b"], expected_text="a\nb", strict=True)
    assert expect_output("\x1b[31ma\x1b[0mb", expected_text="ab")
    assert not expect_output("\x1b[31ma\x1b[0mb", expected_text="ab", strip_ansi_escape_sequences=False)
    with pytest.raises(ValueError, match="Either lines or text, but not both"):
        expect_output("a", lines=["a"], expected_text="a")
    with pytest.raises(ValueError, match="Either expected lines or text, but not both"):
        expect_output("a")
