"""Which nodes an event is for; programs import it as `launch_ros.events.matchers`."""

from collections.abc import Callable
from typing import Any

__all__ = ["matches_node_name"]


def matches_node_name(node_name: str) -> Callable[[Any], bool]:
    """A matcher for the node with this full name; a name without a slash is in no namespace."""
    full = node_name if node_name.startswith("/") else f"/{node_name}"
    return lambda action: getattr(action, "node_name", None) == full
