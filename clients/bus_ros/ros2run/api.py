"""`ros2run.api`: the file of a package's program, and its run as a child process."""

import signal
import subprocess
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from bus_ros.ros2pkg.api import PackageNotFound, get_executable_paths

__all__ = [
    "ROS2RUN_MSG_PREFIX",
    "MultipleExecutables",
    "PackageNotFound",
    "get_executable_path",
    "get_executable_paths",
    "run_executable",
]

ROS2RUN_MSG_PREFIX = "[ros2run]:"


class MultipleExecutables(Exception):
    """A package has several programs of one name; `paths` are their files."""

    def __init__(self, paths: Iterable[str]) -> None:
        super().__init__(paths)
        self.paths = paths


def get_executable_path(*, package_name: str, executable_name: str) -> str | None:
    """The file of a program; None if the package has no such program.

    Raises PackageNotFound, and MultipleExecutables if folders of the package have programs of that name.
    """
    found = [
        path for path in get_executable_paths(package_name=package_name) if Path(path).name == executable_name
    ]
    if len(found) > 1:
        raise MultipleExecutables(found)
    return found[0] if found else None


def run_executable(*, path: str, argv: Sequence[str], prefix: Sequence[str] | None = None) -> int:
    """Run a program to its end, with the words of `prefix` before it; returns its code.

    The code is minus the number of a signal that ended it. Prints a line for each code but 0. Ctrl-C goes to
    the program, and this call still waits for its end.
    """
    process = subprocess.Popen([*(prefix or ()), path, *argv])
    while process.returncode is None:
        with suppress(KeyboardInterrupt):
            process.wait()
    code = process.returncode
    if code:
        by_signal = -code in signal.valid_signals()
        print(
            ROS2RUN_MSG_PREFIX,
            signal.strsignal(-code) if by_signal else f"Process exited with failure {code}",
        )
    return code
