"""The folders of packages: prefixes and share folders.

Owns: the search. It looks for a package in this order:

- below the prefixes (`search_paths`)
- the source folder of a package that was installed with `pip install --editable`
- the source folder of a package that is not installed, around the current folder
- share folders and programs that come with busd

Must not know: the use of packages.
"""

import re
import sys
import warnings
from pathlib import Path
from typing import Final

import bus
from bus_ros import packages
from bus_ros.ament_index_python.search_paths import get_search_paths

__all__ = [
    "PackageNotFoundError",
    "get_package_prefix",
    "get_package_share_directory",
    "get_package_share_path",
    "get_packages_with_prefixes",
]

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]+")
_SHIPPED: Final = Path(str(bus.__file__)).parent
"""The prefix of the share folders that come with busd: definitions, and launch files for turtles."""


class PackageNotFoundError(KeyError):
    """There is no package of that name."""

    def __str__(self) -> str:
        return str(self.args[0])


def get_packages_with_prefixes() -> dict[str, str]:
    """The names of all packages that are installed or come with busd, and the prefix of each."""
    found: dict[str, str] = {}
    for prefix in get_search_paths():
        for folder, only in ((Path(prefix, packages.INDEX), ""), (Path(prefix, "share"), "package.xml")):
            for entry in folder.iterdir() if folder.is_dir() else ():
                if not entry.name.startswith(".") and (entry / only).is_file():
                    found.setdefault(entry.name, prefix)
    for name in packages.names():
        found.setdefault(name, sys.prefix)
    for entry in (_SHIPPED / "share").iterdir():
        found.setdefault(entry.name, str(_SHIPPED))
    for name in packages.built_in():
        found.setdefault(name, sys.prefix)
    return found


def get_package_prefix(package_name: str) -> str:
    """The prefix of a package. Raises PackageNotFoundError, and ValueError if the name is not valid."""
    return _find(package_name)[0]


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """The share folder of a package, with its launch files, for example; raises as `get_package_prefix`.

    Warns if the folder does not exist, unless `print_warning` is false.
    """
    return str(_share(package_name, print_warning, "directory"))


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """As `get_package_share_directory`, as a path."""
    return _share(package_name, print_warning, "path")


def _share(name: str, is_warned: bool, what: str) -> Path:
    path = _find(name)[1]
    if is_warned and not path.exists():
        warnings.warn(f"Share {what} for {name} ({path}) does not exist.", stacklevel=3)
    return path


def _find(name: str) -> tuple[str, Path]:
    """The prefix of a package, and the path of its share folder."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' is not a valid package name")
    paths = get_search_paths()
    for prefix in paths:
        share = Path(prefix, "share", name)
        if Path(prefix, packages.INDEX, name).is_file() or (share / "package.xml").is_file():
            return prefix, share
    if (source := packages.editable_folder(name) or packages.source_folder(name)) is not None:
        return sys.prefix, source
    if (share := _SHIPPED / "share" / name).is_dir():
        return str(_SHIPPED), share
    if name in packages.built_in():
        return sys.prefix, Path(sys.prefix, "share", name)
    raise PackageNotFoundError(f"package '{name}' not found, searching: {paths}")
