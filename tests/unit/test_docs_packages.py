"""The docstring of each package has the information for a change to it, and its paths exist."""

import ast
import re
from pathlib import Path

from rows import for_each

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(
    str(path.parent.relative_to(ROOT))
    for root in ("busd", "clients")
    for path in (ROOT / root).rglob("__init__.py")
)
MOST_LINES = 36
"""About half a page. Packages with an example for users may have more."""

CODE = re.compile(r"`([^`\n]+)`")
FILE = re.compile(r"[\w/-]+(\.(py|pyi|h|c|md|toml|js|html)|/)")
ROOTED = re.compile(r"\b(?:docs|tests|busd|clients|benchmarks)/[\w/-]+(?:\.(?:py|md|toml)|/)")
FOR_USERS = {"clients/bus", "clients/bus/msg", "clients/bus/srv"}
"""The docstrings of these packages are only for users."""


def docstring(package: str) -> str:
    return ast.get_docstring(ast.parse((ROOT / package / "__init__.py").read_text())) or ""


@for_each("package", PACKAGES)
def test_paths_lead_somewhere(package: str) -> None:
    text = docstring(package)
    paths = [span for span in CODE.findall(text) if FILE.fullmatch(span)] + ROOTED.findall(text)
    assert [path for path in paths if not any((at / path).exists() for at in (ROOT, ROOT / package))] == []


@for_each("package", [package for package in PACKAGES if package not in FOR_USERS])
def test_says_what_to_read_and_what_tests_it(package: str) -> None:
    text = docstring(package)
    assert len(text.splitlines()) <= MOST_LINES
    assert "Read first: " in text
    assert re.search(r"\bTests?: .*`tests/", text, re.DOTALL)
