"""Completion in the shell: launch files, packages and their programs."""

import os
from argparse import Namespace
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from bus_cli.completion import packages
from bus_cli.launch.files import ENDS, find_launch_file, launch_files
from bus_cli.output import CommandError

__all__ = ["complete_file_or_package", "complete_launch_words", "complete_run_words"]


def complete_file_or_package(prefix: str, **_: Any) -> list[str]:
    """For `bus launch`: packages, and launch files in the typed folder."""
    return [*packages(prefix), *_files(prefix, ENDS)]


def complete_launch_words(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """After a package, its launch files. After a file, its arguments, except the ones already given."""
    first, given = parsed_args.package_or_file, list(parsed_args.words or ())
    try:
        path, words = find_launch_file(first, [word for word in given if word != prefix])
    except CommandError:
        return [] if os.sep in first else sorted({path.name for path in launch_files(first)})
    have = {word.partition(":=")[0] for word in words}
    return [f"{name}:=" for name in _arguments(path) if name not in have]


def complete_run_words(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """For `bus run`: packages and scripts, then the package's programs. The program has the other words."""
    given = [word for word in parsed_args.words or () if word != prefix]
    if not given:
        return [*packages(prefix), *_files(prefix, (".py", ".pyz"))]
    from bus_ros.packages import executables

    if len(given) > 1 or given[0].endswith((".py", ".pyz")):
        return []
    return [one.name for one in executables(given[0]) or ()]


def _files(prefix: str, ends: tuple[str, ...]) -> Iterator[str]:
    """Matching files and all folders. Folders end with a slash, so the shell continues inside them."""
    folder = Path(prefix).parent if prefix else Path()
    try:
        found = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return
    for path in found:
        if path.is_dir():
            yield f"{path}{os.sep}"
        elif path.name.endswith(ends):
            yield str(path)


def _arguments(path: str) -> list[str]:
    """Names of the arguments that a launch file declares; none if the file has errors."""
    import_module("bus_ros.import_hook")
    sources: Any = import_module("launch.launch_description_sources")
    try:
        description = sources.get_launch_description_from_any_launch_file(path)
        return [one.name for one in description.get_launch_arguments()]
    except Exception:
        return []
