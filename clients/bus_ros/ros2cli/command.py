"""`ros2cli.command`: the base of commands that plugins of `ros2` have, and their verbs as subparsers.

The program `bus` itself does not load plugins. A plugin's own program or test can use these names.
"""

import inspect
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Collection, Sequence
from typing import Any

from bus_ros.ros2cli.entry_points import get_entry_points, get_first_line_doc
from bus_ros.ros2cli.plugin_system import PLUGIN_SYSTEM_VERSION, instantiate_extensions, satisfies_version

__all__ = ["CommandExtension", "add_subparsers_on_demand", "get_command_extensions"]


class CommandExtension:
    """The base of a command. A derived class has `main(self, *, parser, args)`. `NAME` is the name of its
    entry point.
    """

    NAME: str | None = None
    EXTENSION_POINT_VERSION = "0.1"

    def __init__(self) -> None:
        super().__init__()
        satisfies_version(PLUGIN_SYSTEM_VERSION, f"^{self.EXTENSION_POINT_VERSION}")

    def add_arguments(
        self, parser: ArgumentParser, cli_name: str, *, argv: Sequence[str] | None = None
    ) -> None:
        """Add the command's arguments to `parser`; `cli_name` is the command line before them."""

    def main(self, *, parser: ArgumentParser, args: Any) -> Any:
        raise NotImplementedError


def get_command_extensions(
    group_name: str, *, exclude_names: Collection[str] | None = None
) -> dict[str, Any]:
    """The commands in a group of entry points, by name."""
    extensions = instantiate_extensions(group_name, exclude_names=exclude_names)
    for name, extension in extensions.items():
        extension.NAME = name
    return extensions


def add_subparsers_on_demand(
    parser: ArgumentParser,
    cli_name: str,
    dest: str,
    group_name: str,
    hide_extensions: Collection[str] | None = None,
    required: bool = True,
    argv: Sequence[str] | None = None,
) -> Any:
    """Add a subparser for each extension in a group of entry points; returns argparse's action.

    The chosen extension becomes the attribute `dest` of the parsed arguments. If `argv` (by default the
    program's arguments) names extensions, only these are loaded, otherwise all, for the list in the help.
    `hide_extensions`: names that the list leaves out.
    """
    names = sorted(get_entry_points(group_name))
    words = sys.argv[1:] if argv is None else argv
    named = [name for name in names if name in words]
    extensions = get_command_extensions(group_name, exclude_names=set(names) - set(named or names))
    listed = {name: one for name, one in extensions.items() if name not in (hide_extensions or ())}
    width = max(map(len, listed), default=0)
    choices = parser.add_subparsers(
        title="Commands",
        description="".join(
            f"{name.ljust(width)}  {get_first_line_doc(one)}\n" for name, one in sorted(listed.items())
        ),
        metavar=f"Call `{cli_name} <command> -h` for more detailed usage.",
        dest=f" {dest.lstrip('_')}",
        required=required,
    )
    for name in names:
        below = choices.add_parser(name, formatter_class=RawDescriptionHelpFormatter)
        extension = extensions.get(name)
        if extension is None:
            continue
        below.description = get_first_line_doc(extension)
        below.set_defaults(**{dest: extension})
        add = getattr(extension, "add_arguments", None)
        if add is not None:
            options = {"argv": argv} if "argv" in inspect.signature(add).parameters else {}
            add(below, f"{cli_name} {name}", **options)
    return choices
