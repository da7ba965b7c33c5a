"""`ros2cli.entry_points`: entry points of installed distributions, by their group."""

import logging
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from typing import Any

__all__ = ["get_entry_points", "get_first_line_doc", "load_entry_points"]

_logger = logging.getLogger(__name__)


def get_entry_points(group_name: str) -> dict[str, EntryPoint]:
    """The entry points of a group, by name."""
    return {one.name: one for one in entry_points(group=group_name)}


def load_entry_points(group_name: str, *, exclude_names: Collection[str] | None = None) -> dict[str, Any]:
    """The objects of the entry points of a group, by name.

    An entry point that can't be loaded is left out, with a warning in the log.
    """
    found = {}
    for name, one in get_entry_points(group_name).items():
        if name in (exclude_names or ()):
            continue
        try:
            found[name] = one.load()
        except Exception as error:  # of the plugin's module
            _logger.warning(f"Failed to load entry point '{name}': {error}")
    return found


def get_first_line_doc(any_type: object) -> str:
    """The first line of the docstring, without its full stop; empty if there is none."""
    lines = (any_type.__doc__ or "").strip().splitlines()
    return lines[0].strip().rstrip(".") if lines else ""
