"""The ament index: resources of any type by name, from the first prefix that has them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from bus_ros.ament_index_python.constants import RESOURCE_INDEX_SUBFOLDER
from bus_ros.ament_index_python.search_paths import get_search_paths

__all__ = [
    "InvalidResourceNameError",
    "InvalidResourceTypeNameError",
    "get_resource",
    "get_resource_types",
    "get_resources",
    "has_resource",
]


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
    return Path(prefix, RESOURCE_INDEX_SUBFOLDER, resource_type, resource_name).read_text(), prefix


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
    return False


def get_resources(resource_type: str) -> dict[str, str]:
    """The names of all resources of a type, and the prefix of each."""
    _check_type(resource_type)
    found: dict[str, str] = {}
    for prefix, folder in _folders():
        for path in _listed(folder / resource_type):
            if path.is_file():
                found.setdefault(path.name, prefix)
    return found


def get_resource_types() -> set[str]:
    """The names of all types that have a resource folder."""
    return {path.name for _, folder in _folders() for path in _listed(folder) if path.is_dir()}


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
