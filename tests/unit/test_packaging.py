"""The metadata of busd's packages: the version, the licence, the page on an index."""

import re
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

import bus
from bus.base.version import RELEASE
from bus.wire.layout import PROTOCOL_VERSION
from setup_functions import load_setup
from wheels.contents import check_sdist
from wheels.sources import copy_tree, tracked, why_not_tracked

ROOT = Path(__file__).parents[2]


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUP = load_setup()
LINK = re.compile(r"\]\((?!https?:)")
FOR_DEVELOPERS = {"bench", "dev", "docs", "fuzz", "release", "soak"}


def test_the_version_has_one_source() -> None:
    assert PROJECT["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "bus.base.version.RELEASE"}
    assert bus.__version__ == RELEASE
    assert re.fullmatch(r"\d+\.\d+\.\d+", RELEASE)


def test_the_changelog_begins_with_this_release() -> None:
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    released = [heading for heading in headings if heading != "Unreleased"]
    assert re.fullmatch(rf"{re.escape(RELEASE)} - \d{{4}}-\d\d-\d\d", released[0])


def test_the_changelog_names_the_protocol() -> None:
    newest = (ROOT / "CHANGELOG.md").read_text().partition(f"## {RELEASE} ")[2].partition("\n## ")[0]
    assert f"Protocol version {PROTOCOL_VERSION}." in newest


def test_the_licence_is_what_bus_pkg_create_writes() -> None:
    """Both texts are the published text of the licence."""
    given = ROOT / "clients" / "bus_cli" / "pkg" / "licenses" / "Apache-2.0.txt"
    assert PROJECT["project"]["license"] == "Apache-2.0"
    assert (ROOT / "LICENSE").read_text() == given.read_text()


def test_the_page_on_an_index_leads_nowhere_that_is_not_there() -> None:
    """The page has no files beside it, so links and pictures need a full address."""
    page = (ROOT / PROJECT["project"]["readme"]).read_text()
    assert page.startswith("# busd\n\n```sh\npip install busd\n```\n")
    assert not LINK.search(page)
    named = {
        name for row in re.findall(r"^\| `.*", page, re.MULTILINE) for name in re.findall(r"`([\w-]+)`", row)
    }
    assert named == set(PROJECT["project"]["optional-dependencies"]) - FOR_DEVELOPERS


def test_the_core_is_built_where_it_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    for wish, optional in (("auto", True), ("yes", False)):
        monkeypatch.setenv("BUS_NATIVE", wish)
        cores = [(core.name, core.optional) for core in SETUP["extensions"]()]
        names = ("bus.shm._core", "bus_tf2.core._core", "bus_bag.core._core")
        assert cores == [(name, optional) for name in names]
    monkeypatch.setenv("BUS_NATIVE", "no")
    assert SETUP["extensions"]() == []
    monkeypatch.setenv("BUS_NATIVE", "maybe")
    with pytest.raises(SystemExit, match="'maybe'; it must be auto, yes or no"):
        SETUP["extensions"]()


@pytest.mark.parametrize("place", ["free-threaded", "darwin", "pypy"])
def test_where_the_core_can_not_be_built_it_says_why(
    place: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if place == "darwin":
        monkeypatch.setattr(sys, "platform", place)
    elif place == "pypy":
        monkeypatch.setattr(sys.implementation, "name", place)
    else:
        monkeypatch.setattr(sysconfig, "get_config_var", lambda name: int(name == "Py_GIL_DISABLED"))
    monkeypatch.setenv("BUS_NATIVE", "auto")
    assert SETUP["extensions"]() == []
    told = capsys.readouterr().err
    assert told.startswith("busd is built without its native core: it needs ")
    assert place in told
    monkeypatch.setenv("BUS_NATIVE", "yes")
    with pytest.raises(SystemExit, match=f"BUS_NATIVE=yes: the native core can't be built: .*{place}"):
        SETUP["extensions"]()


def test_the_source_distribution_has_all_files_under_version_control(tmp_path: Path) -> None:
    if reason := why_not_tracked():
        pytest.skip(reason)
    copy_tree(tmp_path / "tree")
    uncompressed = ["--formats=tar", "--dist-dir", str(tmp_path)]
    command = [sys.executable, "setup.py", "-q", "sdist", *uncompressed]
    done = subprocess.run(command, cwd=tmp_path / "tree", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (sdist,) = tmp_path.glob("*.tar")
    check_sdist(sdist, tracked())
