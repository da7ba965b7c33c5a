"""The containers, for `bus run rclpy_components`: `component_container`, and `component_container_mt`.

`component_container_isolated` is `component_container_mt`: in both, a component does not wait for another.
"""

import sys
from contextlib import suppress

import bus_ros.rclpy as rclpy
from bus_ros.entity import Entity, Work
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.executors import (
    Executor,
    ExternalShutdownException,
    MultiThreadedExecutor,
    Ready,
    SingleThreadedExecutor,
)
from bus_ros.rclpy_components.component_manager import ComponentManager

__all__ = ["main", "main_mt"]


class _Container(Executor):
    """An executor that a component may leave in the middle of a call.

    `unload_node` destroys a component's node at once, also while another thread, or a coroutine, is in a
    callback of it. That callback's next use of the node raises InvalidHandle, which must end nothing else.
    """

    def _run(self, entity: Ready, work: Work) -> bool:
        try:
            return super()._run(entity, work)
        except InvalidHandle as error:
            called = entity if isinstance(entity, Entity) else entity.holder
            if called is None or not called.is_destroyed:
                raise
            called.node.get_logger().warning(f"a callback was not finished before the unloading: {error}")
            return True


class _SingleThreaded(_Container, SingleThreadedExecutor):
    pass


class _MultiThreaded(_Container, MultiThreadedExecutor):
    pass


def main() -> int:
    """All components share one thread."""
    return _run(_SingleThreaded)


def main_mt() -> int:
    """Callbacks of components run in several threads."""
    return _run(_MultiThreaded)


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
