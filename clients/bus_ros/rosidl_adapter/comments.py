"""Comments in definitions: at the beginning of a file, and of fields and constants."""

import re
import textwrap
from itertools import takewhile
from typing import Any, Final, Protocol

from bus_ros.rosidl_adapter.names import COMMENT_DELIMITER

__all__ = ["extract_file_level_comments", "process_comments"]

_UNIT: Final = re.compile(r"(\s*\[([^,\]]+)\])")
"""A unit in brackets: `[m/s]`. With a comma it is a range."""


class Annotated(Protocol):
    """Something with comments."""

    annotations: dict[str, Any]


def extract_file_level_comments(message_string: str) -> tuple[list[str], list[str]]:
    """The comments at the very beginning of a definition, without `#`, and its other lines."""
    lines = message_string.splitlines()
    comments = list(takewhile(lambda line: line.startswith(COMMENT_DELIMITER), lines))
    return [line.lstrip(COMMENT_DELIMITER) for line in comments], lines[len(comments) :]


def process_comments(instance: Annotated) -> None:
    """Tidy the lines of `annotations["comment"]`, and move a unit in them to `annotations["unit"]`."""
    lines: list[str] | None = instance.annotations.get("comment")
    if lines is None:
        return
    units = _UNIT.findall("\n".join(lines))
    if len(units) == 1:
        text, instance.annotations["unit"] = units[0]
        lines[:] = [line.replace(text, "") for line in lines]
    lines[:] = _without_needless(lines)
    if lines:
        instance.annotations["comment"] = textwrap.dedent("\n".join(lines)).split("\n")


def _without_needless(lines: list[str]) -> list[str]:
    """Without empty lines at both ends, and with one empty line instead of several."""
    kept: list[str] = []
    for line in lines:
        if line or (kept and kept[-1]):
            kept.append(line)
    return kept if not kept or kept[-1] else kept[:-1]
