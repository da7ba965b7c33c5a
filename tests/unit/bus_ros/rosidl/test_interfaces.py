"""Questions about interfaces: the lists, files and kinds that `rosidl_runtime_py` gives."""

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from bus.types import definitions
from bus_ros.rosidl import action_class, message_class, runtime, service_class
from bus_ros.rosidl.definition import Array, BasicType, NamespacedType
from bus_ros.rosidl.interfaces import (
    get_action_interfaces,
    get_action_namespaced_type,
    get_interface_packages,
    get_interface_path,
    get_interfaces,
    get_message_interfaces,
    get_message_namespaced_type,
    get_namespaced_type,
    get_service_interfaces,
    get_service_namespaced_type,
    import_message_from_namespaced_type,
    is_action,
    is_message,
    is_service,
)
from rows import for_each

SHARE = Path(definitions.__file__).parents[1] / "share"
Header: Any = message_class("std_msgs/msg/Header")


@pytest.fixture(autouse=True)
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with a message."""
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    for name, text in {
        "demo/package.xml": "<package><name>demo</name></package>",
        "demo/msg/Wheel.msg": "float64 speed\n",
    }.items():
        (tmp_path / "src" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "src" / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "src"


def test_interfaces_of_packages() -> None:
    assert get_interfaces(["demo", "std_srvs"]) == {
        "demo": ["msg/Wheel"],
        "std_srvs": ["srv/Empty", "srv/SetBool", "srv/Trigger"],
    }
    assert get_message_interfaces(["tf2_msgs"]) == {"tf2_msgs": ["msg/TF2Error", "msg/TFMessage"]}
    assert get_service_interfaces(["tf2_msgs", "std_msgs"]) == {"tf2_msgs": ["srv/FrameGraph"]}
    assert get_action_interfaces(["tf2_msgs"]) == {"tf2_msgs": ["action/LookupTransform"]}
    with pytest.raises(LookupError, match="Unknown package 'no_such_msgs'"):
        get_interfaces(["no_such_msgs"])


def test_interfaces_of_all_packages(workspace: Path) -> None:
    assert {"demo", "std_msgs", "std_srvs"} <= set(get_interfaces())
    assert "std_srvs" not in get_message_interfaces()
    places = get_interface_packages()
    assert places["demo"] == str(workspace)
    assert places["std_msgs"] == str(SHARE)


@for_each("name", ["std_msgs/msg/Bool", "std_msgs/msg/Bool.msg"])
def test_the_file_of_an_interface(name: str) -> None:
    assert get_interface_path(name) == str(SHARE / "std_msgs" / "msg" / "Bool.msg")


@for_each(
    ("name", "error", "text"),
    [
        ("Bool", ValueError, "Expected at least two parts separated by '/'"),
        ("std_msgs//Bool", ValueError, "Must not contain empty parts"),
        ("std_msgs/../Bool", ValueError, "Must not contain '..'"),
        ("no_such_msgs/msg/Bool", LookupError, "Unknown package 'no_such_msgs'"),
        ("std_msgs/msg/Nothing", LookupError, "Could not find the interface 'std_msgs/msg/Nothing'"),
        ("std_msgs/Bool", LookupError, "Could not find the interface 'std_msgs/Bool'"),
    ],
)
def test_an_interface_without_a_file(name: str, error: type[Exception], text: str) -> None:
    with pytest.raises(error, match=text.replace(".", r"\.")):
        get_interface_path(name)


def test_kinds() -> None:
    empty, fibonacci = (
        service_class("std_srvs/srv/Empty"),
        action_class("example_interfaces/action/Fibonacci"),
    )
    for check, kind in ((is_message, Header), (is_service, empty), (is_action, fibonacci)):
        assert [check(one) for one in (Header, empty, fibonacci)] == [
            one is kind for one in (Header, empty, fibonacci)
        ]
    assert is_message(Header())


def test_names_as_types() -> None:
    for made in (
        get_namespaced_type("std_msgs/msg/Bool"),
        get_message_namespaced_type("std_msgs/Bool"),
        get_message_namespaced_type("std_msgs/msg/Bool"),
    ):
        assert (made.namespaces, made.name) == (["std_msgs", "msg"], "Bool")
    assert get_service_namespaced_type("std_srvs/Empty").namespaces == ["std_srvs", "srv"]
    assert get_action_namespaced_type("tf2_msgs/LookupTransform").namespaces == ["tf2_msgs", "action"]


def test_the_class_of_a_type(monkeypatch: pytest.MonkeyPatch) -> None:
    """The modules are those that programs import; here others stand for them."""
    fibonacci: Any = action_class("example_interfaces/action/Fibonacci")
    for name, content in (("std_msgs.msg", {"Header": Header}), ("demo.action", {"Fibonacci": fibonacci})):
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], ModuleType("package"))
        monkeypatch.setitem(sys.modules, name, module)
    header = NamespacedType(["std_msgs", "msg"], "Header")
    assert import_message_from_namespaced_type(header) is Header
    assert import_message_from_namespaced_type(Array(header, 3)) is Header
    feedback = NamespacedType(["demo", "action"], "Fibonacci_FeedbackMessage")
    assert import_message_from_namespaced_type(feedback) is fibonacci.Impl.FeedbackMessage


def test_the_types_of_fields() -> None:
    found = runtime.get_message_slot_types(Header())
    assert list(found) == ["stamp", "frame_id"]
    assert isinstance(found["stamp"], NamespacedType)
    assert isinstance(runtime.get_message_slot_types(message_class("std_msgs/msg/Bool")())["data"], BasicType)
