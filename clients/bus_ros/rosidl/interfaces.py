"""The interfaces that exist, their files, and their kinds: parts of `rosidl_runtime_py`.

Owns: questions about names. Must not know: the making of classes.
"""

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from bus.types.definitions import KINDS, Kind, definition_path, find_path, names, packages
from bus_ros.rosidl.definition import NamespacedType

__all__ = [
    "get_action_interfaces",
    "get_action_namespaced_type",
    "get_interface_packages",
    "get_interface_path",
    "get_interfaces",
    "get_message_interfaces",
    "get_message_namespaced_type",
    "get_namespaced_type",
    "get_service_interfaces",
    "get_service_namespaced_type",
    "import_message_from_namespaced_type",
    "is_action",
    "is_message",
    "is_service",
]


def get_interface_packages() -> dict[str, str]:
    """The packages that have interfaces, each with the folder that its folder is in."""
    first = {name.partition("/")[0]: name for name in reversed(names())}
    return {package: str(definition_path(first[package]).parents[2]) for package in packages()}


def get_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The interfaces of packages, by default of all: `{"std_msgs": ["msg/Bool", ...], ...}`.

    A package without interfaces is left out. Raises LookupError for an unknown package.
    """
    return _interfaces(package_names, None)


def get_message_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The messages of packages, as in `get_interfaces`."""
    return _interfaces(package_names, "msg")


def get_service_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The services of packages, as in `get_interfaces`."""
    return _interfaces(package_names, "srv")


def get_action_interfaces(package_names: Iterable[str] = ()) -> dict[str, list[str]]:
    """The actions of packages, as in `get_interfaces`."""
    return _interfaces(package_names, "action")


def get_interface_path(interface_name: str) -> str:
    """The file of `std_msgs/msg/Bool`, also with its suffix.

    Raises ValueError for a malformed name, LookupError for an unknown interface.
    """
    parts = interface_name.split("/")
    if len(parts) < 2:
        text = f"Invalid name '{interface_name}'. Expected at least two parts separated by '/'"
        raise ValueError(text)
    if not all(parts):
        raise ValueError(f"Invalid name '{interface_name}'. Must not contain empty parts")
    if ".." in parts:
        raise ValueError(f"Invalid name '{interface_name}'. Must not contain '..'")
    kind = parts[-2]
    found = find_path(interface_name.removesuffix(f".{kind}")) if kind in KINDS else None
    if found is None:
        _check_package(parts[0])
        raise LookupError(f"Could not find the interface '{interface_name}'")
    return found


def get_namespaced_type(identifier: str) -> NamespacedType:
    """`std_msgs/msg/Bool` as a NamespacedType."""
    return _namespaced(identifier, None)


def get_message_namespaced_type(identifier: str) -> NamespacedType:
    """`std_msgs/msg/Bool` or `std_msgs/Bool` as a NamespacedType."""
    return _namespaced(identifier, "msg")


def get_service_namespaced_type(identifier: str) -> NamespacedType:
    """`std_srvs/srv/Empty` or `std_srvs/Empty` as a NamespacedType."""
    return _namespaced(identifier, "srv")


def get_action_namespaced_type(identifier: str) -> NamespacedType:
    """`tf2_msgs/action/LookupTransform` or `tf2_msgs/LookupTransform` as a NamespacedType."""
    return _namespaced(identifier, "action")


def import_message_from_namespaced_type(message_type: Any) -> Any:
    """The class of a NamespacedType, or of an array's elements."""
    wanted = getattr(message_type, "value_type", message_type)
    module = import_module(".".join(wanted.namespaces))
    action, _, part = wanted.name.rpartition("_")
    if part == "FeedbackMessage":
        return getattr(getattr(module, action).Impl, part)
    return getattr(module, wanted.name)


def is_message(interface: Any) -> bool:
    """Whether it is a message or its class."""
    return hasattr(interface, "SLOT_TYPES")


def is_service(interface: Any) -> bool:
    """Whether it is the class of a service."""
    return hasattr(interface, "Request") and hasattr(interface, "Response")


def is_action(interface: Any) -> bool:
    """Whether it is the class of an action."""
    return all(hasattr(interface, part) for part in ("Goal", "Result", "Feedback"))


def _interfaces(package_names: Iterable[str], kind: Kind | None) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for package in list(package_names) or packages():
        _check_package(package)
        if listed := [name.partition("/")[2] for name in names(kind, package)]:
            found[package] = listed
    return found


def _check_package(package: str) -> None:
    from bus_ros.packages import find_prefix  # late: it looks through folders

    if not names(None, package) and find_prefix(package) is None:
        raise LookupError(f"Unknown package '{package}'")


def _namespaced(identifier: str, kind: str | None) -> NamespacedType:
    *namespaces, name = identifier.split("/")
    if len(namespaces) == 1 and kind is not None:
        namespaces.append(kind)
    return NamespacedType(namespaces, name)
