"""The output of programs without parts that differ in each run, and the difference of two outputs."""

import ast
import difflib
import re
from pathlib import Path

FOLDER = Path(__file__).parent
PROGRAMS = {path.stem: path for path in sorted((FOLDER / "programs").glob("*.py")) if path.stem != "show"}
SHARE = FOLDER / "share"
"""For BUS_INTERFACE_PATH."""

_CHANCE = (
    (r", at /[\w/.]+:\d+", ""),  # a place in the C sources
    (r"0x[0-9a-f]+", "0x..."),
    (r"\[\d{10}\.\d{9}\]", "[time]"),
    (r'File ".*", line \d+', 'File "...", line ...'),
)


def normalized(text: str) -> list[str]:
    for pattern, shown in _CHANCE:
        text = re.sub(pattern, shown, text)
    return text.splitlines()


def recording(name: str) -> Path:
    return FOLDER / "recorded" / f"{name}.txt"


def recorded(name: str) -> list[str]:
    return recording(name).read_text().splitlines()


def asks(name: str) -> str:
    """The first line of the program's docstring."""
    return (ast.get_docstring(ast.parse(PROGRAMS[name].read_text())) or "").partition("\n")[0]


def difference(genuine: list[str], ours: list[str]) -> list[str]:
    """The lines that only rclpy prints, after -, and the lines that only busd prints, after +."""
    lines = list(difflib.unified_diff(genuine, ours, n=0, lineterm=""))[2:]
    return [line for line in lines if not line.startswith("@@")]
