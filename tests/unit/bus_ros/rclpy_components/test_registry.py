"""Component types of installed packages, and node classes by name."""

import sys
from pathlib import Path

import pytest

from bus_ros.rclpy.node import Node
from bus_ros.rclpy_components.registry import ComponentError, ComponentType, component_types, find_class

ENTRIES = """\
[console_scripts]
talk = my_arm_parts:main
[rclpy_components]
my_arm::Talker = my_arm_parts:Parts.Talker [extra]
other::Listener = my_arm_parts:Listener
Plain = my_arm_parts:Plain
"""
MODULE = """\
from bus_ros.rclpy.node import Node
class Parts:
    class Talker(Node):
        pass
class Listener(Node):
    pass
number = 3
"""


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A distribution with components, in a folder of sys.path, which is also the current folder."""
    metadata = tmp_path / "my_arm-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: my-arm\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRIES)
    (tmp_path / "my_arm_parts.py").write_text(MODULE)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    monkeypatch.delitem(sys.modules, "my_arm_parts", raising=False)
    return tmp_path


def test_types_of_installed_packages(arm: Path) -> None:
    assert component_types() == [
        ComponentType("my-arm", "Plain", "my_arm_parts:Plain"),
        ComponentType("my_arm", "my_arm::Talker", "my_arm_parts:Parts.Talker"),
        ComponentType("other", "other::Listener", "my_arm_parts:Listener"),
    ]


def test_types_of_a_workspace_that_is_not_sourced(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = arm / "ws" / "install" / "demo" / "lib" / version / "site-packages"
    (arm / "ws" / "install" / "demo" / "share" / "demo").mkdir(parents=True)
    (arm / "ws" / "install" / ".colcon_install_layout").write_text("isolated\n")
    (site / "demo-1.0.dist-info").mkdir(parents=True)
    (site / "demo-1.0.dist-info" / "METADATA").write_text("Name: demo\nVersion: 1.0\n")
    (site / "demo-1.0.dist-info" / "entry_points.txt").write_text("[rclpy_components]\ndemo::A = demo_a:A\n")
    (site / "demo_a.py").write_text("from bus_ros.rclpy.node import Node\nclass A(Node):\n    pass\n")
    monkeypatch.chdir(arm / "ws")
    assert ComponentType("demo", "demo::A", "demo_a:A") in component_types()
    assert find_class("demo", "demo::A").__module__ == "demo_a"


@pytest.mark.parametrize(
    ("package", "plugin", "name"),
    [
        ("my_arm", "my_arm::Talker", "Parts.Talker"),
        ("my_arm", "Talker", "Parts.Talker"),
        ("other", "other::Listener", "Listener"),
        ("anything", "my_arm_parts:Listener", "Listener"),
        ("anything", "my_arm_parts:Parts.Talker", "Parts.Talker"),
    ],
)
def test_a_class_by_its_name(arm: Path, package: str, plugin: str, name: str) -> None:
    found = find_class(package, plugin)
    assert issubclass(found, Node)
    assert found.__qualname__ == name


@pytest.mark.parametrize(
    ("package", "plugin", "text"),
    [
        ("my_arm", "my_arm::Taker", "no component 'my_arm::Taker' in Python; did you mean 'my_arm::Talker'?"),
        ("nosuch", "nosuch::X", "no component 'nosuch::X' in Python; components in C\\+\\+ can't be loaded"),
        ("my-arm", "Plain", "Module 'my_arm_parts' has no class 'Plain'"),
        ("x", "my_arm_parts:number", "'my_arm_parts:number' is not a class of nodes"),
        ("x", "my_arm_parts:Parts", "'my_arm_parts:Parts' is not a class of nodes"),
        ("x", "a b:c", "no component 'a b:c' in Python"),
    ],
)
def test_what_can_not_be_loaded(arm: Path, package: str, plugin: str, text: str) -> None:
    with pytest.raises(ComponentError, match=text):
        find_class(package, plugin)


def test_a_module_that_is_missing(arm: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match="nosuch_module"):
        find_class("x", "nosuch_module:Class")
