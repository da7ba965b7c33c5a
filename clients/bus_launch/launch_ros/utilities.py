"""Functions for those who write actions; programs import it as `launch_ros.utilities`."""

from bus_launch.launch_ros.namespaces import (
    is_namespace_absolute,
    is_root_namespace,
    make_namespace_absolute,
    prefix_namespace,
)

__all__ = [
    "is_namespace_absolute",
    "is_root_namespace",
    "make_namespace_absolute",
    "prefix_namespace",
]
