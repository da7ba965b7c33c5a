"""All definitions by package, and their files; programs import it as `rosidl_runtime_py.get_interfaces`.

Owns: lists of names in ROS 2's form. Must not know: the content of definitions.
"""

from collections.abc import Iterable
from typing import Final

from bus.errors import ConfigurationError
from bus.types.definitions import KINDS, Kind, definition_path, names
from bus_ros.ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_path,
)
from bus_ros.ament_index_python.resources import get_resources

__all__ = [
    "get_action_interfaces",
    "get_interface_packages",
    "get_interface_path",
    "get_interfaces",
    "get_message_interfaces",
    "get_service_interfaces",
]

Interfaces = dict[str, list[str]]

_NO_PACKAGES: Final[tuple[str, ...]] = ()


def get_interface_packages() -> dict[str, str]:
    """The packages that have definitions, and the prefix of each.

    Without an installed package it is the folder above the package's.
    """
    return get_resources("rosidl_interfaces")


def get_interfaces(package_names: Iterable[str] = _NO_PACKAGES) -> Interfaces:
    """All definitions of these packages (none: of all) by package: `msg/String`, `srv/SetBool`.

    A package without definitions is left out. Here and below, raises LookupError for an unknown package.
    """
    return _interfaces(package_names, None)


def get_message_interfaces(package_names: Iterable[str] = _NO_PACKAGES) -> Interfaces:
    """As `get_interfaces`, messages alone."""
    return _interfaces(package_names, "msg")


def get_service_interfaces(package_names: Iterable[str] = _NO_PACKAGES) -> Interfaces:
    """As `get_interfaces`, services alone."""
    return _interfaces(package_names, "srv")


def get_action_interfaces(package_names: Iterable[str] = _NO_PACKAGES) -> Interfaces:
    """As `get_interfaces`, actions alone."""
    return _interfaces(package_names, "action")


def get_interface_path(interface_name: str) -> str:
    """The file of `std_msgs/msg/String`; the suffix may be there: `std_msgs/msg/String.msg`.

    Raises ValueError for an invalid name, LookupError for an unknown package or definition.
    """
    parts = interface_name.split("/")
    if len(parts) < 2:
        fault = "Expected at least two parts separated by '/'"
    elif not all(parts):
        fault = "Must not contain empty parts"
    elif ".." in parts:
        fault = "Must not contain '..'"
    else:
        return _path(parts)
    raise ValueError(f"Invalid name '{interface_name}'. {fault}")


def _path(parts: list[str]) -> str:
    package, name = parts[0], "/".join(parts)
    for kind in KINDS:
        if len(parts) == 3 and parts[1] == kind:
            try:
                return str(definition_path(name.removesuffix(f".{kind}")))
            except ConfigurationError:
                break
    try:
        share = get_package_share_path(package, print_warning=False)
    except (PackageNotFoundError, ValueError):
        if package in _by_package(None):
            raise LookupError(f"Could not find the interface '{name}'") from None
        raise LookupError(f"Unknown package '{package}'") from None
    path = share.joinpath(*parts[1:])
    if not path.is_file():
        raise LookupError(f"Could not find the interface '{path}'")
    return str(path)


def _interfaces(package_names: Iterable[str], kind: Kind | None) -> Interfaces:
    found = _by_package(kind)
    wanted = list(package_names)
    if not wanted:
        return _short(found)
    every = _by_package(None)
    for package in wanted:
        if package not in every:
            _check_package(package)
    return _short({package: found[package] for package in wanted if package in found})


def _check_package(package: str) -> None:
    try:
        get_package_prefix(package)
    except (PackageNotFoundError, ValueError):
        raise LookupError(f"Unknown package '{package}'") from None


def _by_package(kind: Kind | None) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name in names(kind):
        found.setdefault(name.partition("/")[0], []).append(name)
    return found


def _short(found: dict[str, list[str]]) -> Interfaces:
    return {package: [name.partition("/")[2] for name in full] for package, full in found.items()}
