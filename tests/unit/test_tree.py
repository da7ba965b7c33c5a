"""The shape of the tree: packaged files, the length of files, the public names."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import bus

ROOT = Path(__file__).parents[2]
SOURCES = [
    path
    for folder in ("busd", "clients", "tests", "examples", "benchmarks")
    for path in (ROOT / folder).rglob("*.py")
]
MAX_LINES = 600
UNIT = ROOT / "tests" / "unit"
OF_SEVERAL = {
    "bus/delivery/test_between_brokers.py",  # sender and receiver, busd away
    "bus/delivery/test_bridging.py",  # mirrors and taps, at both ends
    "bus/delivery/test_close.py",  # endpoints that close, and their senders
    "bus/delivery/test_liveliness.py",  # matches of the receiver and events of the subscription
    "bus/delivery/test_loan.py",  # bus.loan, by both senders
    "bus/test_hostile_numbers.py",  # all numbers from other processes
    "bus/test_timing.py",  # all timed actions
    "test_makefile.py",
    "test_packaging.py",
    "test_tree.py",
    "test_tree_map.py",
}
"""Unit tests of several modules. Their names state their subject."""


def test_every_folder_with_sources_is_packaged() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    roots = [(ROOT / "busd", ROOT), *((path, ROOT / "clients") for path in (ROOT / "clients").iterdir())]
    folders = {
        ".".join(path.parent.relative_to(base).parts)
        for root, base in roots
        for path in root.rglob("*.py")
        if "share" not in path.parts  # launch files are data
    }
    assert set(project["tool"]["setuptools"]["packages"]) == folders


def test_no_file_has_outgrown_one_subject() -> None:
    lengths = {path.relative_to(ROOT): len(path.read_text().splitlines()) for path in SOURCES}
    assert {path: length for path, length in lengths.items() if length > MAX_LINES} == {}


def test_unit_tests_lie_and_are_named_as_what_they_test() -> None:
    """For example, tests/unit/bus/wire/test_runs.py, or test_runs_SUBJECT.py, tests
    clients/bus/wire/runs.py.
    """
    lost = {
        str(path.relative_to(UNIT))
        for path in UNIT.rglob("test_*.py")
        if not any(re.match(rf"{name}(_|$)", path.stem[5:]) for name in _modules_for(path.parent))
    }
    assert lost == OF_SEVERAL, "move or rename them, or say in OF_SEVERAL of what they are"


def _modules_for(tests: Path) -> set[str]:
    """Modules and packages of the folder that this folder mirrors, and that folder's name."""
    part = tests.relative_to(UNIT)
    folders = [path for path in (ROOT / part, ROOT / "clients" / part) if path.is_dir()]
    modules = {path.name.partition(".")[0].lstrip("_") for one in folders for path in one.iterdir()}
    return (modules | {part.name} if folders else set()) - {""}


def test_clients_is_a_source_root_and_no_package() -> None:
    assert not (ROOT / "clients" / "__init__.py").exists()


def test_all_public_names_exist_and_are_listed() -> None:
    assert [name for name in bus.__all__ if getattr(bus, name, None) is None] == []
    assert sorted(bus.__all__, key=lambda name: (name.lower() == name, name)) == list(bus.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        bus.nonsense  # noqa: B018


@pytest.mark.parametrize("heavy", ["asyncio", "uvloop", "yaml", "msgspec"])
def test_importing_bus_loads_nothing_heavy(heavy: str) -> None:
    code = f"import sys, bus; sys.exit({heavy!r} in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
