"""rclpy.experimental: nodes on asyncio's event loop, as in ROS 2 Lyrical.

    `async_node.py` --> `async_publisher.py`, `async_subscription.py`, `async_service.py`, `async_client.py`
          |             `async_timer.py`, `async_clock.py`: each on top of an object of the library `bus`
          |
    `../impl/openings.py`  the endpoints of an event loop that busd does not know yet

Invariants:

- A callback runs on the event loop of the node, in its task group if it is a coroutine. There is no
  executor, no lock and no other thread.
- Programs make endpoints without `await`, also before the loop runs. busd learns them when the node runs, or
  in the next turn of the loop. Until then a publisher holds its messages, so a subscription made before them
  gets them.

Read first: `async_node.py`.

Tests: `tests/system/test_rclpy_async_node.py`, `tests/system/test_rclpy_async_topics.py`,
`tests/system/test_rclpy_async_actions.py`, `tests/unit/bus_ros/rclpy/impl/`.
"""

from bus_ros.rclpy.executors import EventsExecutor
from bus_ros.rclpy.experimental.async_action import AsyncActionClient, AsyncActionServer
from bus_ros.rclpy.experimental.async_client import AsyncClient
from bus_ros.rclpy.experimental.async_clock import AsyncClock
from bus_ros.rclpy.experimental.async_lifecycle import AsyncLifecycleNode, AsyncLifecyclePublisher
from bus_ros.rclpy.experimental.async_node import AsyncNode
from bus_ros.rclpy.experimental.async_publisher import AsyncPublisher
from bus_ros.rclpy.experimental.async_service import AsyncService
from bus_ros.rclpy.experimental.async_subscription import AsyncSubscription
from bus_ros.rclpy.experimental.async_timer import AsyncTimer

__all__ = [
    "AsyncActionClient",
    "AsyncActionServer",
    "AsyncClient",
    "AsyncClock",
    "AsyncLifecycleNode",
    "AsyncLifecyclePublisher",
    "AsyncNode",
    "AsyncPublisher",
    "AsyncService",
    "AsyncSubscription",
    "AsyncTimer",
    "EventsExecutor",
]
