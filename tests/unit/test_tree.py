"""The shape of the tree: what is packaged, how long files are, what the public surface is."""

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


def test_every_folder_with_sources_is_packaged() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    roots = [(ROOT / "busd", ROOT), *((path, ROOT / "clients") for path in (ROOT / "clients").iterdir())]
    folders = {
        ".".join(path.parent.relative_to(base).parts) for root, base in roots for path in root.rglob("*.py")
    }
    assert set(project["tool"]["setuptools"]["packages"]) == folders


def test_no_file_has_outgrown_one_subject() -> None:
    lengths = {path.relative_to(ROOT): len(path.read_text().splitlines()) for path in SOURCES}
    assert {path: length for path, length in lengths.items() if length > MAX_LINES} == {}


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
