"""`bus.base.optional` and the pages name the same packages as the extras in pyproject.toml."""

import re
import tomllib
from pathlib import Path

import pytest

from bus.base.optional import BOUNDS, how_to_install
from rows import for_each

ROOT = Path(__file__).parents[4]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
FOR_DEVELOPERS = {"bench", "dev", "docs", "fuzz", "release", "soak"}
FOR_USERS = {name: wanted for name, wanted in EXTRAS.items() if name not in FOR_DEVELOPERS}
SILENT = {"rich"}
"""Packages whose absence no program mentions."""
REQUIREMENT = re.compile(r"([\w-]+)([^;]*)")
PAGES = {path for folder in ("", "docs", "benchmarks") for path in (ROOT / folder).glob("*.md")}
PAGES -= {ROOT / "PACKAGE.md"}  # that page is for readers who found busd on an index


def test_bounds_are_those_of_the_extras() -> None:
    wanted = {REQUIREMENT.findall(text)[0] for texts in FOR_USERS.values() for text in texts}
    assert {(name, bounds) for name, bounds in wanted if name not in SILENT} == set(BOUNDS.items())


def test_the_command() -> None:
    assert how_to_install("mcap") == "pip install 'mcap>=1.3,<2'"
    with pytest.raises(KeyError):
        how_to_install("requests")


def test_pages_list_all_extras() -> None:
    text = (ROOT / "docs" / "README.md").read_text().partition("\n## Extras\n")[2]
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| `")]
    listed = {row[0].strip("| `"): re.findall(r"`([\w-]+)`", row[1]) for row in rows}
    assert listed == {
        name: [REQUIREMENT.findall(one)[0][0] for one in texts] for name, texts in FOR_USERS.items()
    }


@for_each("page", PAGES)
def test_pages_name_an_extra_in_one_form(page: Path) -> None:
    """No index has busd, so a name on an index (`busd[web]`) would install nothing."""
    text = page.read_text()
    assert not re.findall(r"pip install[^\n]*busd\[", text)
    for command, names in re.findall(r"(pip install[^\n`]*\.)\[([\w,]+)\]", text):
        assert command == "pip install -e '."
        assert set(names.split(",")) <= set(EXTRAS)
