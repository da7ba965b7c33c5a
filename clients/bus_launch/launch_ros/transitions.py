"""Talks to a lifecycle node that a launch has started: requests transitions, and receives reports of the
transitions made.

On the bus, by the names that ROS 2 has: the service NODE/change_state and the topic NODE/transition_event.
"""

import asyncio
import os
from typing import Any

from bus.errors import BusError
from bus_launch.launch import logging
from bus_launch.launch.core import LaunchContext
from bus_launch.launch_ros.events.lifecycle import StateTransition

__all__ = ["Transitions"]


class Transitions:
    """The transitions of one node, an action with a `node_name`.

    It begins with `run`, and ends with the node's process.
    """

    def __init__(self, node: Any, context: LaunchContext) -> None:
        self._node = node
        self._context = context
        self._asked: asyncio.Queue[int] = asyncio.Queue()

    def ask(self, transition_id: int) -> None:
        """Ask for a transition once all earlier requests are answered."""
        self._asked.put_nowait(transition_id)

    async def run(self, done: "asyncio.Future[None]") -> None:
        """Until the node's process has ended."""
        talk = asyncio.create_task(self._talk())
        await asyncio.wait([talk, done], return_when=asyncio.FIRST_COMPLETED)
        if not talk.done():
            talk.cancel()
        try:
            await talk
        except asyncio.CancelledError:
            pass
        except BusError as error:
            _log_error(f"LifecycleNode '{self._node.node_name}' gets no transitions: {error}")

    async def _talk(self) -> None:
        from bus.node import Node as BusNode  # late: few launch files have such nodes
        from bus.types.classes import message_class, service_class

        name = self._node.node_name
        event = message_class("lifecycle_msgs/msg/TransitionEvent")
        change = service_class("lifecycle_msgs/srv/ChangeState")
        async with BusNode(f"launch_ros_{os.getpid()}_{id(self._node)}", arguments=()) as own:
            await own.create_subscription(event, f"{name}/transition_event", 100, self._on_transition)
            client = await own.create_client(change, f"{name}/change_state")
            while True:
                number = await self._asked.get()
                request = change.Request()
                request.transition.id = number
                failed = f"Failed to make transition '{number}' for LifecycleNode '{name}'"
                try:
                    await client.wait_for_service()
                    answer = await client.call(request)
                except BusError as error:  # for example its process has died; it may be started again
                    _log_error(f"{failed}: {error}")
                else:
                    if not answer.success:
                        _log_error(failed)

    def _on_transition(self, message: Any) -> None:
        self._context.emit_event_sync(StateTransition(action=self._node, msg=message))


def _log_error(text: str) -> None:
    logging.get_logger("launch_ros").error(text)
