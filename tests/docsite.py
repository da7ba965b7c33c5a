"""The site that `make docs` builds, and the parts and pages that it is to have."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

_PART = re.compile(r"^## (.*)\n\n.*\n\n\| page \| subject \|\n\|---\|---\|\n((?:\|.*\n)+)", re.MULTILINE)
_ROW = re.compile(r"^\| \[([^\]]+)\]\(([^)]+)\) \| .+ \|$", re.MULTILINE)

Parts = dict[str, list[tuple[str, str]]]
"""Titles and paths of the pages of each part. A path starts in docs/."""


def parts_of_index() -> Parts:
    """The tables of docs/README.md."""
    return {title: _ROW.findall(rows) for title, rows in _PART.findall((DOCS / "README.md").read_text())}


def parts_of_site() -> Parts:
    """The navigation of mkdocs.yml."""
    _, *parts = yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]
    return {
        title: [(name, re.sub("^project/", "../", path)) for page in pages for name, path in page.items()]
        for part in parts
        for title, pages in part.items()
    }


def build(folder: Path) -> Path:
    """Build the site in `folder`. Without mkdocs the test is skipped, a page with a dead link fails it."""
    if importlib.util.find_spec("material") is None:
        pytest.skip("no mkdocs-material: `make docs` installs it")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def page_of(path: str) -> str:
    """Path on the site of a page. The page's path starts in docs/."""
    name = re.sub(r"^\.\./", "project/", path).removesuffix(".md")
    return re.sub("README$", "index", name) + ".html"
