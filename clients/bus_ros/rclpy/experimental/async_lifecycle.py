"""Lifecycle nodes on asyncio's event loop, which ROS 2 does not have yet."""

from typing import Any, TypeVar

from bus.base.awaited import to_be_awaited
from bus_ros.rclpy.experimental.async_node import AsyncNode
from bus_ros.rclpy.experimental.async_publisher import AsyncPublisher
from bus_ros.rclpy.lifecycle.managed_entity import TransitionCallbackReturn
from bus_ros.rclpy.lifecycle.node import LifecycleNodeMixin, TransitionSteps
from bus_ros.rclpy.lifecycle.publisher import PublishesWhileActive

__all__ = ["AsyncLifecycleNode", "AsyncLifecyclePublisher"]

M = TypeVar("M")


class AsyncLifecyclePublisher(PublishesWhileActive, AsyncPublisher[M]):
    """Made by `create_lifecycle_publisher` of an AsyncLifecycleNode."""

    _publisher_class = AsyncPublisher


class AsyncLifecycleNode(LifecycleNodeMixin, AsyncNode):
    """An AsyncNode that other programs configure, activate and shut down; it takes its arguments, too.

    `on_configure` and the other callbacks are `def` or `async def`. The triggers are awaited:
    `await node.trigger_configure()`. Transitions never overlap if other programs request them.
    """

    _lifecycle_publisher_class = AsyncLifecyclePublisher

    def __init__(
        self, node_name: str, *, enable_communication_interface: bool = True, **keywords: Any
    ) -> None:
        AsyncNode.__init__(self, node_name, **keywords)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)

    @to_be_awaited
    async def _run_transition(self, steps: TransitionSteps) -> TransitionCallbackReturn:
        try:
            result = next(steps)
            while True:
                if hasattr(result, "__await__"):
                    try:
                        result = await result
                    except Exception as error:
                        result = steps.throw(error)
                        continue
                result = steps.send(result)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
