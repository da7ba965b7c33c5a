"""Finds expected texts and lines in output: a text, a pattern, or several of them in turn.

Each matcher returns the begin and the end of the match, or None. Pure.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeAlias

__all__ = ["build_line_match", "build_text_match", "normalize_lineseps", "without_escapes"]

Span: TypeAlias = tuple[int, int]
_Find: TypeAlias = Callable[[Any, Any, int, bool], Span | None]

_ESCAPE: Final = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|[@-Z\\^_])")


def without_escapes(text: str) -> str:
    """The text without a terminal's escape sequences, such as colours."""
    return _ESCAPE.sub("", text)


def normalize_lineseps(lines: str) -> str:
    r"""The text with `\n` at the ends of lines: a terminal puts `\r\n`."""
    return lines.replace("\r\n", "\n")


def build_text_match(expected_text: Any, *, strict: bool = False) -> Callable[..., Span | None]:
    """A matcher of texts: `match(text, start=0)`.

    With `strict`, the match begins at `start`, and an expected text is the whole rest. Raises
    ValueError for an expectation of another kind.
    """
    match = _build(expected_text, strict, _in_text)

    def find(actual_text: str, start: int = 0) -> Span | None:
        return match(normalize_lineseps(actual_text), start)

    return find


def build_line_match(expected_lines: Any, *, strict: bool = False) -> Callable[..., Span | None]:
    """A matcher of lists of lines: `match(lines, start=0)`.

    A text may be anywhere in a line, a pattern matches at a line's begin. With `strict`, a single expectation
    is for every line, and several are for lines without others between them. Raises ValueError for an
    expectation of another kind.
    """
    return _build(expected_lines, strict, _in_lines)


def _build(expected: Any, is_strict: bool, find: _Find) -> Callable[..., Span | None]:
    if isinstance(expected, str) or hasattr(expected, "match"):
        return lambda actual, start=0: find(expected, actual, start, is_strict)
    if not isinstance(expected, Iterable):
        raise ValueError("Unknown format for expected output: it must be a text, a pattern or a list of them")
    several = [_build(one, False, find) for one in expected]

    def find_all(actual: Any, start: int = 0) -> Span | None:
        first, end = None, start
        for match in several:
            span = match(actual, end)
            if span is None or (is_strict and span[0] != end):
                return None
            first = span[0] if first is None else first
            end = span[1]
        return (start if first is None else first), end

    return find_all


def _in_text(expected: Any, text: str, start: int, is_strict: bool) -> Span | None:
    if isinstance(expected, str):
        if is_strict:
            return (start, len(text)) if text[start:] == expected else None
        place = text.find(expected, start)
        return None if place < 0 else (place, place + len(expected))
    found = expected.match(text, start) if is_strict else expected.search(text, start)
    return None if found is None else (found.start(), found.end())


def _in_lines(expected: Any, lines: Sequence[str], start: int, is_strict: bool) -> Span | None:
    def fits(line: str) -> bool:
        if not isinstance(expected, str):
            return expected.match(line) is not None
        return line == expected if is_strict else expected in line

    if is_strict:
        return (start, len(lines)) if all(map(fits, lines[start:])) else None
    place = next((place for place in range(start, len(lines)) if fits(lines[place])), None)
    return None if place is None else (place, place + 1)
