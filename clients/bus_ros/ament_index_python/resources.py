"""The ament index: resources of any type by name, from the first prefix that has them.

Packages that are found without an index have resources, too: each has one of the type `packages`. A package
with definitions also has one of the type `rosidl_interfaces`, which lists them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, Literal

from bus.types import definitions
from bus_ros.ament_index_python.constants import RESOURCE_INDEX_SUBFOLDER
from bus_ros.ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_packages_with_prefixes,
)
from bus_ros.ament_index_python.search_paths import get_search_paths

__all__ = [
    "InvalidResourceNameError",
    "InvalidResourceTypeNameError",
    "get_resource",
    "get_resource_types",
    "get_resources",
    "has_resource",
]

_PACKAGES: Final = "packages"
_DEFINITIONS: Final = "rosidl_interfaces"


class InvalidResourceTypeNameError(ValueError):
    """The name of a resource type contains a slash, so it would lead to another folder."""


class InvalidResourceNameError(ValueError):
    """The name of a resource contains a slash, so it would lead to another folder."""


def get_resource(resource_type: str, resource_name: str) -> tuple[str, str]:
    """The content of a resource, and its prefix; raises LookupError if there is none.

    Here and in all functions below, an empty name raises AssertionError. A name with a slash raises
    InvalidResourceTypeNameError or InvalidResourceNameError.
    """
    prefix = has_resource(resource_type, resource_name)
    if not prefix:
        raise LookupError(f"Could not find the resource '{resource_name}' of type '{resource_type}'")
    path = Path(prefix, RESOURCE_INDEX_SUBFOLDER, resource_type, resource_name)
    if path.is_file():
        return path.read_text(), prefix
    return _list_of_definitions(resource_name) if resource_type == _DEFINITIONS else "", prefix


def has_resource(resource_type: str, resource_name: str) -> str | Literal[False]:
    """The prefix of a resource, or False."""
    _check_type(resource_type)
    if not resource_name:
        raise AssertionError("The resource name must not be empty")
    if _is_path(resource_name):
        raise InvalidResourceNameError(f"Resource name '{resource_name}' is invalid")
    for prefix, folder in _folders():
        if (folder / resource_type / resource_name).is_file():
            return prefix
    return _without_index(resource_type, resource_name) or False


def get_resources(resource_type: str) -> dict[str, str]:
    """The names of all resources of a type, and the prefix of each."""
    _check_type(resource_type)
    found: dict[str, str] = {}
    for prefix, folder in _folders():
        for path in _listed(folder / resource_type):
            if path.is_file():
                found.setdefault(path.name, prefix)
    others: dict[str, str] = {}
    if resource_type == _PACKAGES:
        others = get_packages_with_prefixes()
    elif resource_type == _DEFINITIONS:
        others = {name: _prefix_of_definitions(name) for name in definitions.packages()}
    return others | found


def get_resource_types() -> set[str]:
    """The names of all types that have a resource folder."""
    found = {path.name for _, folder in _folders() for path in _listed(folder) if path.is_dir()}
    return found | {_PACKAGES, _DEFINITIONS}


def _without_index(resource_type: str, resource_name: str) -> str | None:
    """The prefix of a package that has no file in an index; None if it has no such resource."""
    if resource_type == _DEFINITIONS and definitions.names(package=resource_name):
        return _prefix_of_definitions(resource_name)
    return _prefix(resource_name) if resource_type == _PACKAGES else None


def _prefix(package: str) -> str | None:
    try:
        return get_package_prefix(package)
    except (PackageNotFoundError, ValueError):
        return None


def _prefix_of_definitions(package: str) -> str:
    """The prefix of a package; the folder above its own if it is a package for definitions alone."""
    found = _prefix(package)
    return found or str(definitions.definition_path(definitions.names(package=package)[0]).parents[2])


def _list_of_definitions(package: str) -> str:
    """One line for each: `msg/String.msg`."""
    parts = [name.split("/") for name in definitions.names(package=package)]
    return "".join(f"{kind}/{name}.{kind}\n" for _, kind, name in parts)


def _folders() -> Iterator[tuple[str, Path]]:
    for prefix in get_search_paths():
        yield prefix, Path(prefix, RESOURCE_INDEX_SUBFOLDER)


def _listed(folder: Path) -> list[Path]:
    """The entries of a folder that are not hidden; an empty list if the folder does not exist."""
    return [path for path in folder.iterdir() if not path.name.startswith(".")] if folder.is_dir() else []


def _check_type(resource_type: str) -> None:
    if not resource_type:
        raise AssertionError("The resource type must not be empty")
    if _is_path(resource_type):
        raise InvalidResourceTypeNameError(f"Resource type '{resource_type}' is invalid")


def _is_path(name: str) -> bool:
    return "/" in name or "\\" in name or name in (".", "..")
