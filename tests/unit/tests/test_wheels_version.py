"""wheels.version: packages of another release than the tree's are refused."""

from pathlib import Path
from zipfile import ZipFile

import pytest

from bus.base.version import RELEASE
from wheels import Wrong
from wheels.version import check_versions


def make_wheel(folder: Path, name: str, version: str) -> Path:
    wheel = folder / name
    with ZipFile(wheel, "w") as archive:
        archive.writestr(f"busd-{RELEASE}.dist-info/METADATA", f"Name: busd\nVersion: {version}\n\nA page")
    return wheel


def test_packages_of_this_release(tmp_path: Path) -> None:
    check_versions([make_wheel(tmp_path, f"busd-{RELEASE}-py3-none-any.whl", RELEASE)])


def test_another_name(tmp_path: Path) -> None:
    with pytest.raises(Wrong, match=f"busd-9.9.9-py3-none-any.whl is not named busd-{RELEASE}"):
        check_versions([make_wheel(tmp_path, "busd-9.9.9-py3-none-any.whl", RELEASE)])


def test_other_metadata(tmp_path: Path) -> None:
    with pytest.raises(Wrong, match=f"is busd 9.9.9, not busd {RELEASE}"):
        check_versions([make_wheel(tmp_path, f"busd-{RELEASE}-py3-none-any.whl", "9.9.9")])


def test_another_changelog(tmp_path: Path) -> None:
    (tmp_path / "CHANGELOG.md").write_text("## Unreleased\n\n## 9.9.9 - 2027-01-01\n")
    with pytest.raises(Wrong, match=f"begins with 9.9.9, not with {RELEASE}"):
        check_versions([], tmp_path / "CHANGELOG.md")
