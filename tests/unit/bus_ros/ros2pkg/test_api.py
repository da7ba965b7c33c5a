"""Packages, and the files of their programs."""

from pathlib import Path

import pytest

from bus_ros.ros2pkg import api


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A prefix with a package and its programs."""
    programs = tmp_path / "lib" / "my_package"
    for name in ("talker", "folder/listener", ".hidden/other", "data.txt"):
        path = programs / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(0o644 if name.endswith(".txt") else 0o755)
    index = tmp_path / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "my_package").touch()
    (index / "empty_package").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    return tmp_path


def test_programs_of_a_package(prefix: Path) -> None:
    programs = prefix / "lib" / "my_package"
    found = api.get_executable_paths(package_name="my_package")
    assert found == [str(programs / "folder" / "listener"), str(programs / "talker")]
    assert api.get_executable_paths(package_name="empty_package") == []
    assert api.get_executable_paths(package_name="std_msgs") == []
    assert api.get_executable_paths(package_name="turtlesim") == [], "they have no file"


def test_packages(prefix: Path) -> None:
    assert {"my_package", "std_msgs"} <= set(api.get_package_names())
    assert api.package_name_completer() == api.get_package_names()
    assert api.get_prefix_path("my_package") == str(prefix)
    assert api.get_prefix_path("no_such_package") is None


def test_an_unknown_package() -> None:
    with pytest.raises(api.PackageNotFound) as caught:
        api.get_executable_paths(package_name="no_such_package")
    assert caught.value.package_name == "no_such_package"
