"""Where packages are, installed and as source."""

import json
from pathlib import Path
from typing import Any

import pytest

from bus_ros import ament_index_python as ament


def test_packages_below_a_prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "first").touch()
    (tmp_path / "share" / "first").mkdir()
    (tmp_path / "share" / "second").mkdir()
    (tmp_path / "share" / "second" / "package.xml").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}:/nonexistent")
    assert ament.get_search_paths()[:2] == [str(tmp_path), "/nonexistent"]
    assert ament.get_package_prefix("first") == str(tmp_path)
    assert ament.get_package_share_directory("second") == str(tmp_path / "share" / "second")
    assert ament.get_package_share_path("first") == tmp_path / "share" / "first"
    found = ament.get_packages_with_prefixes()
    assert found["first"] == found["second"] == str(tmp_path)


def test_a_package_installed_from_its_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "my source"
    source.mkdir()
    (source / "package.xml").touch()
    info = tmp_path / "site" / "my_robot-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_robot\nVersion: 1.0\n")
    (info / "direct_url.json").write_text(
        json.dumps({"url": source.as_uri(), "dir_info": {"editable": True}})
    )
    monkeypatch.syspath_prepend(str(info.parent))
    assert ament.get_package_share_path("my_robot") == source
    (info / "direct_url.json").write_text(json.dumps({"url": source.as_uri(), "dir_info": {}}))
    with pytest.raises(ament.PackageNotFoundError):
        ament.get_package_share_path("my_robot")  # what was copied can't be told from its source


def test_what_is_no_package(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: Any) -> None:
    with pytest.raises(ament.PackageNotFoundError, match="package 'no_such' not found, searching: "):
        ament.get_package_prefix("no_such")
    with pytest.raises(ValueError, match=r"'\.\./x' is not a valid package name"):
        ament.get_package_share_directory("../x")
    (tmp_path / "share" / "ament_index" / "resource_index" / "packages").mkdir(parents=True)
    (tmp_path / "share" / "ament_index" / "resource_index" / "packages" / "bare").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    ament.get_package_share_directory("bare", print_warning=False)
    assert capsys.readouterr().err == ""
    ament.get_package_share_directory("bare")
    assert "no share directory" in capsys.readouterr().err
