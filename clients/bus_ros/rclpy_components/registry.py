"""Component types of installed packages, and node classes by name.

A package registers a class in its setup.py, in the group of entry points that ROS 2's Python container reads:

    entry_points={"rclpy_components": ["my_robot::Talker = my_robot.talker:Talker"]}

A class can also be named directly, as `my_robot.talker:Talker`.
"""

import os
import re
import sys
from importlib import import_module
from importlib.metadata import DistributionFinder, MetadataPathFinder
from typing import Any, NamedTuple

from bus.base.suggest import did_you_mean
from bus_ros import packages
from bus_ros.rclpy.node import Node

__all__ = ["ComponentError", "ComponentType", "component_types", "find_class"]

GROUP = "rclpy_components"
_TARGET = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


class ComponentError(Exception):
    """A component can't be loaded; the text is for the user."""


class ComponentType(NamedTuple):
    """A registered class: `name` as `my_robot::Talker`, `target` as `my_robot.talker:Talker`."""

    package: str
    name: str
    target: str


def component_types() -> list[ComponentType]:
    """All registered types, sorted, of this Python and of the workspace around the current folder."""
    context = DistributionFinder.Context(path=[*sys.path, *_workspace_folders()])
    found = set()
    for distribution in MetadataPathFinder().find_distributions(context):
        for entry in distribution.entry_points:
            if entry.group == GROUP:
                package = entry.name.partition("::")[0] if "::" in entry.name else distribution.name
                found.add(ComponentType(package, entry.name, entry.value.partition("[")[0].strip()))
    return sorted(found)


def find_class(package: str, plugin: str) -> type[Node]:
    """Import the class of a component. Raises ComponentError, or any error of the imported module."""
    types = [one for one in component_types() if one.package == package]
    registered = next((one for one in types if plugin in (one.name, one.name.partition("::")[2])), None)
    target = registered.target if registered else plugin
    if _TARGET.fullmatch(target) is None:
        near = did_you_mean(plugin, [one.name for one in types])
        why = near or "; components in C++ can't be loaded here"
        raise ComponentError(f"Package '{package}' has no component '{plugin}' in Python{why}")
    _make_importable(package)
    module, _, names = target.partition(":")
    found: Any = import_module(module)
    for name in names.split("."):
        try:
            found = getattr(found, name)
        except AttributeError:
            raise ComponentError(f"Module '{module}' has no class '{names}'") from None
    if not (isinstance(found, type) and issubclass(found, Node)):
        raise ComponentError(f"'{target}' is not a class of nodes")
    return found


def _make_importable(package: str) -> None:
    """Add the folders from which a package can be imported: its workspace, its source, the current folder."""
    source = packages.source_folder(package)
    for folder in (*_workspace_folders(), *([str(source)] if source else []), os.getcwd()):  # noqa: PTH109
        if folder not in sys.path:
            sys.path.append(folder)


def _workspace_folders() -> list[str]:
    prefixes = [one for one in packages.prefixes() if not one.is_ours]
    return [folder for prefix in prefixes for folder in packages.python_folders(prefix)]
