"""docs/rclpy-differences.md: its table of programs, and the differing lines of each.

`write` writes both again and leaves all sentences as they are.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from differential.compare import PROGRAMS, asks

PAGE = Path(__file__).parents[2] / "docs" / "rclpy-differences.md"

_ROW = r"^\| `(\w+)` \| (.*?) \| (.*?) \|\n"
_BLOCK = r"^```diff\n(.*?)^```\n?"


def rows() -> dict[str, tuple[str, str]]:
    """For each program: its subject, and its outcome."""
    found = re.findall(_ROW, PAGE.read_text(), re.MULTILINE)
    return {name: (asked, outcome) for name, asked, outcome in found}


def differences() -> dict[str, list[str]]:
    """For each program with a section: its lines."""
    return {name: _lines(text) for name, text in _sections(PAGE.read_text()).items()}


def write(found: Mapping[str, list[str]]) -> None:
    """Write the page with these lines for these programs, and the present lines for the others."""
    text = PAGE.read_text()
    sections = _sections(text)
    head = text.partition("\n## ")[0].rstrip()
    for name, lines in found.items():
        if not lines:
            sections.pop(name, None)
        elif lines != _lines(sections.get(name, "")):
            why = re.sub(_BLOCK, "", sections.get(name, "Why?"), flags=re.MULTILINE | re.DOTALL).strip()
            sections[name] = "\n".join([f"\n{why}\n\n```diff", *lines, "```"])
    first, *_ = re.finditer(_ROW, head, re.MULTILINE)
    table = [
        f"| `{name}` | {asks(name)} | {'differs' if name in sections else 'same'} |\n" for name in PROGRAMS
    ]
    head = (
        head[: first.start()] + "".join(table) + re.sub(_ROW, "", head[first.start() :], flags=re.MULTILINE)
    )
    parts = [head, *(f"## `{name}`\n{sections[name].rstrip()}" for name in PROGRAMS if name in sections)]
    PAGE.write_text("\n\n".join(parts) + "\n")


def _sections(text: str) -> dict[str, str]:
    return dict(re.findall(r"^## `(\w+)`\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL))


def _lines(section: str) -> list[str]:
    blocks: list[str] = re.findall(_BLOCK, section, re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]
