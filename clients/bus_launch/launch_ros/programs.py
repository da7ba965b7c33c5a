"""Finds a node's program, and the command that starts it."""

import os
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

from bus_launch.launch.core import SubstitutionFailure
from bus_launch.warm import START
from bus_ros import packages

__all__ = ["Program", "find", "find_share", "outside", "package_prefix", "with_sourced_workspace"]


class Program(NamedTuple):
    """A program, and the words that start it."""

    path: str
    start: list[str]


def find(package: str, name: str) -> Program:
    """As `bus run PACKAGE NAME` finds it; raises SubstitutionFailure with the nearest name."""
    found = packages.executables(package)
    if found is None:
        folder = packages.source_folder(package)
        source = None if folder is None else packages.source_programs(folder)
        if source is None:
            raise SubstitutionFailure(_no_package(package))
        found, compiled = source
        if name in compiled:
            raise SubstitutionFailure(
                f"executable '{name}' of package '{package}' must be compiled, with colcon and ROS 2"
            )
    fitting = [one for one in found if one.name == name]
    if not fitting:
        names = [one.name for one in found]
        place = _libexec(package)
        from bus.base.suggest import did_you_mean

        near = did_you_mean(name, names) or (f"; '{package}' has: {', '.join(names)}" if names else "")
        raise SubstitutionFailure(f"executable '{name}' not found on the libexec directory '{place}'{near}")
    if len(fitting) > 1:
        listed = "".join(f"\n- {one.path}" for one in fitting)
        raise SubstitutionFailure(f"executable '{name}' of package '{package}' found more than once:{listed}")
    return _program(fitting[0])


def outside(name: str) -> Program:
    """A program that is in no package: a path, or a name found in PATH.

    A file of Python that is given by its path need not be executable.
    """
    is_python_file = os.sep in name and name.endswith(".py") and Path(name).is_file()
    path = name if is_python_file else shutil.which(name)
    if path is None:
        raise SubstitutionFailure(f"executable '{name}' not found on the PATH")
    return Program(path, _python(path) or [path])


def package_prefix(package: str) -> str:
    """The folder that a package is installed under; raises SubstitutionFailure with the nearest name."""
    from bus_ros import ament_index_python

    try:
        return ament_index_python.get_package_prefix(package)
    except ament_index_python.PackageNotFoundError:
        raise SubstitutionFailure(_no_package(package)) from None
    except ValueError as error:
        raise SubstitutionFailure(str(error)) from None


def find_share(package: str) -> str:
    """The folder with a package's files; raises SubstitutionFailure with the nearest name."""
    from bus_ros import ament_index_python

    try:
        return ament_index_python.get_package_share_directory(package, print_warning=False)
    except ament_index_python.PackageNotFoundError:
        raise SubstitutionFailure(_no_package(package)) from None
    except ValueError as error:
        raise SubstitutionFailure(str(error)) from None


def _program(one: packages.Executable) -> Program:
    if one.entry_point is not None:
        return Program(one.path, [*START, one.path, one.entry_point, "--"])
    return Program(one.path, _python(one.path, one.python_folders) or [one.path])


def _python(path: str, folders: tuple[str, ...] = ()) -> list[str] | None:
    from bus_ros import running

    if not running.is_python(path):
        return None
    paths = [f"--path={folder}" for folder in folders]
    return [*START, *paths, path, "--"]


def _no_package(package: str) -> str:
    from bus_ros import ament_index_python

    near = packages.nearest(package)
    hint = f"; did you mean '{near}'?" if near else ""
    return f"package '{package}' not found, searching: {ament_index_python.get_search_paths()}{hint}"


def _libexec(package: str) -> str:
    prefix = packages.find_prefix(package)
    return str((prefix.path if prefix else Path(sys.prefix)) / "lib" / package)


def with_sourced_workspace() -> None:
    """Set up the environment as if the workspace around the current folder were sourced."""
    new = [prefix for prefix in packages.prefixes() if not prefix.is_sourced]
    if not new:
        return
    from bus_ros import running

    old = os.environ.get("AMENT_PREFIX_PATH")
    os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join([str(one.path) for one in new] + ([old] if old else []))
    folders = [folder for prefix in new for folder in packages.python_folders(prefix)]
    running.add_paths([folder for folder in folders if folder not in sys.path[1:]])
