"""Lists of definitions, and their files."""

from pathlib import Path
from typing import Any

import pytest

import bus
from bus_ros.rosidl import interfaces
from rows import for_each

SHARE = Path(str(bus.__file__)).parent / "share"


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of definitions, and one without."""
    for path, text in {
        "my_msgs/package.xml": "<package><name>my_msgs</name></package>",
        "my_msgs/msg/Wheel.msg": "float64 speed\n",
        "my_msgs/srv/Turn.srv": "---\n",
        "my_code/package.xml": "<package><name>my_code</name></package>",
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_definitions_by_package(workspace: Path) -> None:
    every = interfaces.get_interfaces()
    assert every["my_msgs"] == ["msg/Wheel", "srv/Turn"] and "msg/String" in every["std_msgs"]
    assert interfaces.get_interfaces(["my_msgs"]) == {"my_msgs": ["msg/Wheel", "srv/Turn"]}
    assert interfaces.get_message_interfaces(["my_msgs"]) == {"my_msgs": ["msg/Wheel"]}
    assert interfaces.get_service_interfaces(["my_msgs", "std_msgs"]) == {"my_msgs": ["srv/Turn"]}
    assert interfaces.get_action_interfaces(["example_interfaces"]) == {
        "example_interfaces": ["action/Fibonacci"]
    }
    assert interfaces.get_action_interfaces(["my_msgs", "my_code"]) == {}
    assert "my_msgs" not in interfaces.get_action_interfaces()


def test_packages(workspace: Path) -> None:
    packages = interfaces.get_interface_packages()
    assert packages["std_msgs"] == str(SHARE.parent)
    assert "my_code" not in packages and Path(packages["my_msgs"]).is_dir()


@for_each("get", [interfaces.get_interfaces, interfaces.get_message_interfaces])
def test_unknown_packages(get: Any) -> None:
    with pytest.raises(LookupError, match="Unknown package 'no_such_package'"):
        get(["std_msgs", "no_such_package"])


def test_files(workspace: Path) -> None:
    assert interfaces.get_interface_path("my_msgs/msg/Wheel") == str(workspace / "my_msgs/msg/Wheel.msg")
    string = str(SHARE / "std_msgs/msg/String.msg")
    assert interfaces.get_interface_path("std_msgs/msg/String") == string
    assert interfaces.get_interface_path("std_msgs/msg/String.msg") == string
    assert interfaces.get_interface_path("std_srvs/srv/SetBool").endswith("std_srvs/srv/SetBool.srv")
    assert interfaces.get_interface_path("my_code/package.xml") == str(workspace / "my_code/package.xml")


@for_each(
    ("name", "kind", "text"),
    [
        ("String", ValueError, "Invalid name 'String'. Expected at least two parts separated by '/'"),
        ("std_msgs//String", ValueError, "Invalid name 'std_msgs//String'. Must not contain empty parts"),
        ("std_msgs/../String", ValueError, "Invalid name 'std_msgs/../String'. Must not contain '..'"),
        ("no_msgs/msg/A", LookupError, "Unknown package 'no_msgs'"),
        ("std_msgs/msg/Strin", LookupError, "Could not find the interface '"),
        ("std_msgs/msg/String.idl", LookupError, "Could not find the interface '"),
    ],
)
def test_no_file(name: str, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind) as caught:
        interfaces.get_interface_path(name)
    assert str(caught.value).startswith(text)
