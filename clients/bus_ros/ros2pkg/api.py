"""`ros2pkg.api`: packages, their prefixes and the files of their programs."""

import os
from collections.abc import KeysView
from typing import Any

from bus_ros import packages
from bus_ros.ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_packages_with_prefixes,
)

__all__ = [
    "PackageNotFound",
    "get_executable_paths",
    "get_package_names",
    "get_prefix_path",
    "package_name_completer",
]


class PackageNotFound(Exception):
    """There is no package `package_name`."""

    def __init__(self, package_name: str) -> None:
        super().__init__(package_name)
        self.package_name = package_name


def get_package_names() -> KeysView[str]:
    """The names of all packages that are installed or come with busd."""
    return get_packages_with_prefixes().keys()


def get_prefix_path(package_name: str) -> str | None:
    """The prefix of a package; None if there is no such package."""
    try:
        return get_package_prefix(package_name)
    except (PackageNotFoundError, ValueError):
        return None


def get_executable_paths(*, package_name: str) -> list[str]:
    """The files of a package's programs, sorted by name; raises PackageNotFound.

    They are the executable files in the package's folder, and the console scripts of the distribution with
    its name. Programs that come with busd have no file; `bus run` starts them.
    """
    found = packages.executables(package_name)
    if found is None:
        if get_prefix_path(package_name) is None:
            raise PackageNotFound(package_name)
        return []
    return [one.path for one in found if os.access(one.path, os.X_OK)]


def package_name_completer(**kwargs: Any) -> KeysView[str]:
    """The names of all packages."""
    return get_package_names()
