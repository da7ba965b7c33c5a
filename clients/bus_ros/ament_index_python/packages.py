"""Where packages are installed.

Owns: the search. A package is found below a prefix of $AMENT_PREFIX_PATH, below the prefix of this Python
(there pip puts what `data_files` of a package names), and where its source is, for one that was installed
with `pip install --editable` or lies, not installed, around the current folder. Must not know: interface
definitions.
"""

import os
import re
import sys
from pathlib import Path
from typing import Final

from bus_ros import packages

__all__ = [
    "PackageNotFoundError",
    "get_package_prefix",
    "get_package_share_directory",
    "get_package_share_path",
    "get_packages_with_prefixes",
    "get_search_paths",
]

_NAME: Final = re.compile(r"[^\W\d]\w*", re.ASCII)


class PackageNotFoundError(KeyError):
    """There is no package of that name."""

    def __str__(self) -> str:
        return str(self.args[0])


def get_search_paths() -> list[str]:
    """The prefixes that are searched, the first to be used first."""
    ament = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    return list(dict.fromkeys((*ament, sys.prefix)))


def get_packages_with_prefixes() -> dict[str, str]:
    """Names of the packages in the prefixes, and the prefix of each."""
    found: dict[str, str] = {}
    for prefix in get_search_paths():
        for folder, only in ((Path(prefix, packages.INDEX), ""), (Path(prefix, "share"), "package.xml")):
            for entry in folder.iterdir() if folder.is_dir() else ():
                if not only or (entry / only).is_file():
                    found.setdefault(entry.name, prefix)
    return found


def get_package_prefix(package_name: str) -> str:
    """The prefix of a package. Raises PackageNotFoundError, and ValueError for what is no name."""
    return _find(package_name)[0]


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """The folder with what comes with a package, such as its launch files; raises as `get_package_prefix`."""
    path = _find(package_name)[1]
    if print_warning and not path.exists():
        print(
            f"WARNING: Package {package_name} has no share directory ({path}) but is registered",
            file=sys.stderr,
        )
    return str(path)


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """As `get_package_share_directory`, as a path."""
    return Path(get_package_share_directory(package_name, print_warning))


def _find(name: str) -> tuple[str, Path]:
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' is not a valid package name")
    paths = get_search_paths()
    for prefix in paths:
        share = Path(prefix, "share", name)
        if Path(prefix, packages.INDEX, name).is_file() or (share / "package.xml").is_file():
            return prefix, share
    if (source := packages.editable_folder(name) or packages.source_folder(name)) is not None:
        return sys.prefix, source
    raise PackageNotFoundError(f"package '{name}' not found, searching: {paths}")
