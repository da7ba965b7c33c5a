"""The places of packages, installed and as source."""

import json
import sys
from pathlib import Path

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
    assert ament.get_search_paths() == [str(tmp_path), sys.prefix]
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
        ament.get_package_share_path("my_robot")  # busd can't tell a copied package from its source


def test_a_workspace_that_was_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install = tmp_path / "install"
    (install / "share" / "my_robot").mkdir(parents=True)
    (install / "share" / "my_robot" / "package.xml").touch()
    (install / "setup.sh").touch()
    (tmp_path / "src").mkdir()
    monkeypatch.chdir(tmp_path / "src")
    assert ament.get_package_share_path("my_robot") == install / "share" / "my_robot"
    assert ament.get_packages_with_prefixes()["my_robot"] == str(install)


def test_what_comes_with_busd() -> None:
    assert ament.get_package_prefix("tf2_ros") == sys.prefix
    share = ament.get_package_share_path("sensor_msgs")
    assert (share / "msg" / "Image.msg").is_file()
    assert share == Path(ament.get_package_prefix("sensor_msgs"), "share", "sensor_msgs")
    turtlesim = ament.get_package_share_path("turtlesim")  # this package has programs, too
    assert (turtlesim / "launch" / "multisim.launch.py").is_file()
    assert (turtlesim / "msg" / "Pose.msg").is_file()
    found = ament.get_packages_with_prefixes()
    assert found["tf2_ros"] == sys.prefix
    assert found["turtlesim"] == found["sensor_msgs"] == ament.get_package_prefix("sensor_msgs")


def test_what_is_no_package() -> None:
    with pytest.raises(ament.PackageNotFoundError) as caught:
        ament.get_package_prefix("no_such")
    assert str(caught.value) == f"package 'no_such' not found, searching: {ament.get_search_paths()}"
    for name in ("../x", "a", "_x", "-x", "é1", "x y", "xy\n"):
        with pytest.raises(ValueError) as refused:
            ament.get_package_share_directory(name)
        assert str(refused.value) == f"'{name}' is not a valid package name"


def test_a_package_without_a_share_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "bare").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    ament.get_package_share_directory("bare", print_warning=False)
    share = tmp_path / "share" / "bare"
    for get, what in (
        (ament.get_package_share_directory, "directory"),
        (ament.get_package_share_path, "path"),
    ):
        with pytest.warns(UserWarning) as caught:
            get("bare")
        assert str(caught[0].message) == f"Share {what} for bare ({share}) does not exist."
        assert caught[0].filename == __file__
