"""Whether a node of ROS 2 has names that are possible on this bus."""

from collections.abc import Callable

from bus.errors import ConfigurationError
from bus.names import validate_namespace, validate_node_name

__all__ = ["is_right_node"]


def is_right_node(namespace: str, name: str, warn: Callable[[str], None]) -> bool:
    """Whether this bus can show a node with these names; if not, `warn` is called with the reason."""
    try:
        validate_node_name(name)
        validate_namespace(namespace)
    except ConfigurationError as error:
        full_name = f"{namespace.rstrip('/')}/{name}"
        warn(f"node {full_name!r:.300} of ROS 2 is left out: {str(error).splitlines()[0]}")
        return False
    return True
