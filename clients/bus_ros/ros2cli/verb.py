"""`ros2cli.verb`: the base of verbs that plugins of `ros2` have."""

from argparse import ArgumentParser
from typing import Any

from bus_ros.ros2cli.plugin_system import PLUGIN_SYSTEM_VERSION, instantiate_extensions, satisfies_version

__all__ = ["VerbExtension", "add_task_arguments", "get_verb_extensions"]


class VerbExtension:
    """The base of a verb. A derived class has `main(self, *, args)`, and may have
    `add_arguments(self, parser, cli_name)`. `NAME` is the name of its entry point.
    """

    NAME: str | None = None
    EXTENSION_POINT_VERSION = "0.1"

    def __init__(self) -> None:
        super().__init__()
        satisfies_version(PLUGIN_SYSTEM_VERSION, f"^{self.EXTENSION_POINT_VERSION}")


def get_verb_extensions(name: str) -> dict[str, Any]:
    """The verbs in a group of entry points, by name."""
    extensions = instantiate_extensions(name)
    for verb, extension in extensions.items():
        extension.NAME = verb
    return extensions


def add_task_arguments(parser: ArgumentParser, task_name: str) -> None:
    """Call `add_TASK_arguments` of each plugin in the group `task_name`, with a group of arguments."""
    for name, plugin in get_verb_extensions(task_name).items():
        group = parser.add_argument_group(title=f"Arguments for '{name}' packages")
        add = getattr(plugin, f"add_{task_name}_arguments", None)
        if add is not None:
            add(group)
