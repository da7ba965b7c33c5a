"""What the packages of busd say of themselves: the version, the licence, the page on an index."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

import bus
from bus.release import RELEASE

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUP = runpy.run_path(str(ROOT / "setup.py"), run_name="setup")
LINK = re.compile(r"\]\((?!https?:)")


def test_the_version_has_one_source() -> None:
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "bus.release.RELEASE"}
    assert bus.__version__ == RELEASE
    assert re.fullmatch(r"\d+\.\d+\.\d+", RELEASE)


def test_the_licence_is_what_bus_pkg_create_writes() -> None:
    """Both are the text as it was published."""
    given = ROOT / "clients" / "bus" / "cli" / "pkg" / "licenses" / "Apache-2.0.txt"
    assert PROJECT["project"]["license"] == "Apache-2.0"
    assert (ROOT / "LICENSE").read_text() == given.read_text()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("See [docs/qos.md](docs/qos.md).", "See `docs/qos.md`."),
        ("[all\npages](docs/README.md)", "all\npages (`docs/README.md`)"),
        (
            "[a site](https://example.org/x) and [below](#more)",
            "[a site](https://example.org/x) and [below](#more)",
        ),
        ("```python\nrows[0](a)\n```\n[x](y)", "```python\nrows[0](a)\n```\nx (`y`)"),
    ],
)
def test_links_to_files_become_their_paths(text: str, shown: str) -> None:
    assert SETUP["read_on_an_index"](f"# busd\n{text}") == f"# busd\n\n{SETUP['NOTE']}{shown}"


def test_the_page_on_an_index_leads_nowhere_that_is_not_there() -> None:
    text = (ROOT / "README.md").read_text()
    assert LINK.search(text)
    page = SETUP["read_on_an_index"](text)
    assert not LINK.search(re.sub(r"^```.*?^```$", "", page, flags=re.MULTILINE | re.DOTALL))
    assert page.startswith("# busd\n\nPages named here")
