"""Launch descriptions in tests: perform substitutions, run descriptions, write files."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import bus_ros.import_hook  # noqa: F401 (launch files import `launch`)
from bus_launch.launch import logging
from bus_launch.launch.actions import LogInfo, OpaqueFunction
from bus_launch.launch.core import (
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_service import LaunchService


def perform(sub: SomeSubstitutionsType, **configurations: str) -> str:
    """The text of some substitutions, with these launch configurations."""
    context = LaunchContext()
    context.launch_configurations.update(configurations)
    return perform_substitutions(context, normalize_to_list_of_substitutions(sub))


def run(*entities: LaunchDescriptionEntity, service: LaunchService | None = None) -> int:
    """Run until nothing is left to do; returns the code. Output is on stdout, as with `bus launch`."""
    logging.reset()  # pytest has another stdout for each test
    service = service or LaunchService()
    service.include_launch_description(LaunchDescription(entities))
    try:
        return service.run()
    finally:
        logging.reset()


def note(found: list[Any], value: Callable[[LaunchContext], Any] | str) -> OpaqueFunction:
    """An action that appends a value, or the value of a launch configuration, to a list."""

    def look(context: LaunchContext) -> None:
        found.append(value(context) if callable(value) else context.launch_configurations.get(value))

    return OpaqueFunction(function=look)


def write(folder: Path, files: Mapping[str, str]) -> Path:
    """Write executable files; returns the folder."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    return folder


def said(out: str) -> list[str]:
    """The texts that LogInfo has printed."""
    mark = "[INFO] [launch.user]: "
    return [line.removeprefix(mark) for line in out.splitlines() if line.startswith(mark)]


def says(*texts: SomeSubstitutionsType) -> Iterable[LogInfo]:
    return [LogInfo(msg=text) for text in texts]
