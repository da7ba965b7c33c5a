"""rclpy on the bus: what programs written for ROS 2's Python client library import as `rclpy`.

Never installed under that name: `bus run` and `import bus.rclpy_compat` let programs import it. The functions
here work on the default context and on one executor for all. Submodules are there as attributes once they are
asked for.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from bus_ros import aliases
from bus_ros.rclpy.main import (
    InitContextManager,
    create_node,
    get_global_executor,
    get_rmw_implementation_identifier,
    init,
    ok,
    shutdown,
    spin,
    spin_once,
    spin_until_future_complete,
    try_shutdown,
)
from bus_ros.rclpy.utilities import get_default_context

__all__ = [
    "InitContextManager",
    "create_node",
    "get_default_context",
    "get_global_executor",
    "get_rmw_implementation_identifier",
    "init",
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
]

aliases.install()


def __getattr__(name: str) -> Any:
    if name == "Parameter":
        return import_module("bus_ros.rclpy.parameter").Parameter
    if name == "Node":
        return import_module("bus_ros.rclpy.node").Node
    if name == "Context":
        return import_module("bus_ros.rclpy.context").Context
    if not name.startswith("_") and find_spec(f"bus_ros.rclpy.{name}") is not None:
        return import_module(f"bus_ros.rclpy.{name}")
    raise AttributeError(f"module 'rclpy' has no attribute {name!r}")
