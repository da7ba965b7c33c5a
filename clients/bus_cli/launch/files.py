"""The search for the launch file that a command line names."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from bus_cli.output import CommandError
from bus_cli.program_name import program_name

__all__ = ["ENDS", "find_launch_file", "launch_files"]

ENDS: Final = ("launch.py", "launch.xml", "launch.yaml", "launch.yml")


def find_launch_file(first: str, others: Sequence[str]) -> tuple[str, list[str]]:
    """The path of the file, and the remaining words. Raises CommandError with the nearest name."""
    rest = list(others)
    has_second = bool(rest) and ":=" not in rest[0]
    if not has_second or _is_path(first):
        if os.path.isfile(first):  # noqa: PTH113 (a path as it was typed)
            return os.path.abspath(first), rest  # noqa: PTH100 (does not resolve links)
        if not has_second and not _looks_like_path(first):
            raise CommandError(_only_a_package(first))
        raise CommandError(f"{program_name()} launch: '{first}' does not exist{_near_file(Path(first))}")
    return str(_in_package(first, rest[0])), rest[1:]


def launch_files(package: str) -> list[Path]:
    """Launch files of an installed package; none if there is no such package."""
    from bus_ros import ament_index_python

    try:
        return list(_launch_files(ament_index_python.get_package_share_path(package, print_warning=False)))
    except (ament_index_python.PackageNotFoundError, ValueError):
        return []


def _is_path(first: str) -> bool:
    return os.sep in first or first.endswith(ENDS)


def _looks_like_path(first: str) -> bool:
    return _is_path(first) or "." in first


def _in_package(package: str, name: str) -> Path:
    from bus_ros import ament_index_python
    from bus_ros.packages import nearest

    try:
        share = ament_index_python.get_package_share_path(package, print_warning=False)
    except (ament_index_python.PackageNotFoundError, ValueError) as error:
        near = nearest(package)
        hint = f"; did you mean '{near}'?" if near else ""
        raise CommandError(f"Package '{package}' not found: {error}{hint}") from None
    wanted = Path(name).parts
    found = sorted(
        path
        for path in share.rglob("*")
        if path.relative_to(share).parts[-len(wanted) :] == wanted and path.is_file()
    )
    if not found:
        raise CommandError(
            f"file '{name}' was not found in the share directory of package '{package}' which is at "
            f"'{share}'{_near(name, [path.name for path in _launch_files(share)])}"
        )
    if len(found) > 1:
        listed = ", ".join(f"'{path}'" for path in found)
        raise CommandError(
            f"file '{name}' was found more than once in the share directory of package '{package}': "
            f"[{listed}]"
        )
    return found[0]


def _only_a_package(package: str) -> str:
    from bus_ros import ament_index_python

    try:
        share = ament_index_python.get_package_share_path(package, print_warning=False)
    except (ament_index_python.PackageNotFoundError, ValueError):
        near = _near_file(Path(package))
        return f"{program_name()} launch: '{package}' is neither a launch file nor a package{near}"
    names = sorted(path.name for path in _launch_files(share))
    has = f"it has: {', '.join(names)}" if names else "it has none"
    return f"{program_name()} launch: which launch file of package '{package}'? {has}"


def _launch_files(share: Path) -> Iterator[Path]:
    return (path for path in share.rglob("*") if path.name.endswith(ENDS))


def _near_file(path: Path) -> str:
    return _near(path.name, [one.name for one in _listed(path.parent)])


def _near(name: str, names: Sequence[str]) -> str:
    from bus.base.suggest import did_you_mean

    return did_you_mean(name, names)


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return []
