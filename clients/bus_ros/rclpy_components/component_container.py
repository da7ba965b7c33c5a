"""The containers, for `bus run rclpy_components`: `component_container`, and `component_container_mt`.

`component_container_isolated` is `component_container_mt`: in both, a component does not wait for another.
"""

import sys
from contextlib import suppress

import bus_ros.rclpy as rclpy
from bus_ros.rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    SingleThreadedExecutor,
)
from bus_ros.rclpy_components.component_manager import ComponentManager

__all__ = ["main", "main_mt"]


def main() -> int:
    """All components share one thread."""
    return _run(SingleThreadedExecutor)


def main_mt() -> int:
    """Callbacks of components run in several threads."""
    return _run(MultiThreadedExecutor)


def _run(executor_class: type[Executor]) -> int:
    # The arguments belong to this node alone: `-r __node:=NAME` must not rename its components.
    with rclpy.init(args=[]), suppress(KeyboardInterrupt, ExternalShutdownException):
        executor = executor_class()
        manager = ComponentManager(executor, cli_args=sys.argv[1:])
        executor.add_node(manager)
        try:
            executor.spin()
        finally:
            manager.destroy_node()
    return 0
