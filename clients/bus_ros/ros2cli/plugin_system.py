"""`ros2cli.plugin_system`: objects of the classes that plugins register as entry points."""

import logging
from collections.abc import Callable, Collection, Mapping
from typing import Any

from bus_ros.ros2cli.entry_points import load_entry_points

__all__ = [
    "PLUGIN_SYSTEM_VERSION",
    "PluginException",
    "instantiate_extensions",
    "order_extensions",
    "order_extensions_by_name",
    "satisfies_version",
]

PLUGIN_SYSTEM_VERSION = "0.1"

_logger = logging.getLogger(__name__)
_made: dict[Any, Any] = {}
"""One object of each class."""


class PluginException(Exception):
    """A plugin does not fit."""


def instantiate_extensions(
    group_name: str, *, exclude_names: Collection[str] | None = None, unique_instance: bool = False
) -> dict[str, Any]:
    """An object of each class in a group of entry points, by name.

    A class always has the same object, unless `unique_instance`. A class that can't be loaded or made is left
    out, with a line in the log.
    """
    found = {}
    for name, extension_class in load_entry_points(group_name, exclude_names=exclude_names).items():
        made = None if unique_instance else _made.get(extension_class)
        if made is None:
            try:
                made = extension_class()
            except Exception as error:  # of the plugin's constructor
                level = logging.WARNING if isinstance(error, PluginException) else logging.ERROR
                _logger.log(level, f"Failed to instantiate '{group_name}' extension '{name}': {error}")
                continue
            if not unique_instance:
                _made[extension_class] = made
        found[name] = made
    return found


def order_extensions(
    extensions: Mapping[str, Any], key_function: Callable[[tuple[str, Any]], Any], *, reverse: bool = False
) -> dict[str, Any]:
    """The extensions in the order of `key_function`, a function of a name and its extension."""
    return dict(sorted(extensions.items(), key=key_function, reverse=reverse))


def order_extensions_by_name(extensions: Mapping[str, Any]) -> dict[str, Any]:
    return order_extensions(extensions, lambda pair: pair[0])


def satisfies_version(version: str, caret_range: str) -> None:
    """Raises PluginException if `version` does not fit a range such as `^0.1`.

    The range includes later versions, as long as its first number other than 0 is the same: `^0.1` up to 0.2,
    `^1.4` up to 2.0.
    """
    if not caret_range.startswith("^"):
        raise ValueError(f"'{caret_range}' is not a range such as '^0.1'")
    present, least = _numbers(version), _numbers(caret_range[1:])
    end = (least[0] + 1, 0) if least[0] else (0, least[1] + 1)
    if present < least:
        raise PluginException(
            f"Extension point is too old ({version}), the extension requires '{caret_range[1:]}'"
        )
    if present[:2] >= end:
        raise PluginException(
            f"Extension point is newer ({version}), than what the extension supports '{caret_range[1:]}'"
        )


def _numbers(version: str) -> tuple[int, ...]:
    numbers = [int(one) for one in version.split(".")]
    return tuple(numbers + [0] * (3 - len(numbers)))
