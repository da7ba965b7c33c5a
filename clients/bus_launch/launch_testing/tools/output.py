"""Compares the output of a process with an expectation, and filters it before."""

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from bus_launch.launch_testing.text import build_line_match, build_text_match, without_escapes

__all__ = [
    "basic_output_filter",
    "expect_output",
    "expected_output_from_file",
    "get_default_filtered_patterns",
    "get_default_filtered_prefixes",
]


def get_default_filtered_prefixes() -> list[str]:
    return ["pid", "rc"]


def get_default_filtered_patterns() -> list[str]:
    return []


def basic_output_filter(
    filtered_prefixes: Iterable[str] | None = None, filtered_patterns: Iterable[str] | None = None
) -> Callable[[str], str]:
    """A function that leaves out lines that have one of these prefixes, or match one of these patterns."""
    prefixes = tuple(get_default_filtered_prefixes() if filtered_prefixes is None else filtered_prefixes)
    given = get_default_filtered_patterns() if filtered_patterns is None else filtered_patterns
    patterns = [re.compile(one) for one in given]

    def kept(line: str) -> bool:
        return not line.startswith(prefixes) and not any(one.match(line) for one in patterns)

    return lambda output: "".join(filter(kept, output.splitlines(keepends=True)))


def expected_output_from_file(path: str, encoding: str | None = None) -> list[Any]:
    """The lines of `<path>.txt`, or the patterns in the lines of `<path>.regex`.

    Raises RuntimeError if neither file exists.
    """
    for suffix, convert in ((".txt", str), (".regex", re.compile)):
        file = Path(f"{path}{suffix}")
        if file.is_file():
            return [convert(line) for line in file.read_text(encoding=encoding).splitlines()]
    raise RuntimeError(f"could not find output check file: {path}")


def expect_output(
    text: str | None = None,
    *,
    lines: Iterable[str] | None = None,
    expected_text: Any = None,
    expected_lines: Any = None,
    strip_ansi_escape_sequences: bool = True,
    strict: bool = False,
) -> bool:
    """Whether a text or lines are as expected; see `build_text_match` and `build_line_match`.

    Raises ValueError unless either text or lines are given, and either of the two expectations.
    """
    if (text is None) == (lines is None):
        raise ValueError("Either lines or text, but not both, must be specified")
    if (expected_text is None) == (expected_lines is None):
        raise ValueError("Either expected lines or text, but not both, must be specified")
    clean = without_escapes if strip_ansi_escape_sequences else str
    if expected_text is not None:
        whole = "\n".join(lines or ()) if text is None else text
        return build_text_match(expected_text, strict=strict)(clean(whole)) is not None
    several = list(lines or ()) if text is None else text.splitlines()
    return build_line_match(expected_lines, strict=strict)([clean(line) for line in several]) is not None
