"""Actions of an AsyncNode, which ROS 2 does not have there yet: servers and clients of `bus_actions`."""

import asyncio
from collections.abc import Callable
from functools import wraps
from typing import Any

from bus.base.callbacks import is_async
from bus.errors import ConnectionClosed
from bus.names import request_topic
from bus.node import Node as NativeNode
from bus_actions import ActionClient, ActionServer, ClientGoal
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.impl.async_entity import AsyncEntity, AsyncOwner
from bus_ros.rclpy.impl.openings import Openings

__all__ = ["AsyncActionClient", "AsyncActionServer"]


class AsyncActionServer(AsyncEntity):
    """Made by `AsyncNode.create_action_server`. `native` is a `bus_actions.ActionServer`."""

    def __init__(
        self,
        owner: AsyncOwner,
        action_type: Any,
        action_name: str,
        full_name: str,
        execute_callback: Callable[..., Any],
        *,
        goal_callback: Callable[[Any], Any] | None,
        cancel_callback: Callable[[Any], Any] | None,
        result_timeout: float,
    ) -> None:
        super().__init__(owner)
        self.action_type = action_type
        self.action_name = action_name
        self._goals_topic = _goals_topic(full_name)
        self.native = ActionServer(
            owner.native,
            action_type,
            action_name,
            execute_callback,
            goal_callback=_as_bool(goal_callback),
            cancel_callback=_as_bool(cancel_callback),
            result_timeout=result_timeout,
        )

    # --- inside

    def _read_topic(self) -> str:
        return self._goals_topic

    async def _open(self, native_node: NativeNode) -> None:
        await self.native.open()

    async def _close(self) -> None:
        await self.native.close()


class AsyncActionClient(AsyncEntity):
    """Made by `AsyncNode.create_action_client`."""

    def __init__(self, owner: AsyncOwner, action_type: Any, action_name: str, full_name: str) -> None:
        super().__init__(owner)
        self.action_type = action_type
        self.action_name = action_name
        self._goals_topic = _goals_topic(full_name)
        self._native = ActionClient(owner.native, action_type, action_name)
        self._holds = 1  # until it is open
        self._is_free = asyncio.Event()  # of holds, or destroyed
        self._openings: Openings | None = None

    def server_is_ready(self) -> bool:
        """Whether a server of the action exists; False before the node runs."""
        return self._native.server_is_ready()

    async def wait_for_server(self) -> None:
        """Wait for a server. Has no time limit: use `asyncio.timeout`. Raises as `send_goal`."""
        await self._opened()
        try:
            await self._native.wait_for_server()
        except ConnectionClosed:
            raise self._why_closed() from None

    async def send_goal(
        self, goal: Any, feedback_callback: Callable[[Any], object] | None = None
    ) -> ClientGoal:
        """Send `goal` and wait until it is accepted; returns the goal.

        `await goal.result()` is its Result, `async for feedback in goal` its feedback, `await goal.cancel()`
        cancels it. `feedback_callback` is called with each Feedback instead.

        Before the node runs, and while the client or a server of this event loop is being made, it waits.
        Raises InvalidHandle if the client is destroyed, and as `bus_actions.ActionClient.send_goal`
        GoalRejected and ActionUnavailable. After a cancellation, a goal that the server accepts is canceled.
        """
        await self._opened()
        try:
            sent = await self._native.send_goal(goal)
        except ConnectionClosed:
            raise self._why_closed() from None
        if feedback_callback is not None:
            self._owner.run_in_group(_pass_on(sent, feedback_callback))
        return sent

    # --- for the node and its openings

    def begin(self, openings: Openings) -> None:
        super().begin(openings)
        if not self.is_destroyed:
            self._openings = openings
            openings.add_publisher(self._goals_topic, self)

    def hold(self) -> None:
        self._holds += 1
        self._is_free.clear()

    def release(self) -> None:
        self._holds -= 1
        if not self._holds:
            self._is_free.set()

    # --- inside

    async def _open(self, native_node: NativeNode) -> None:
        await self._native.open()

    def _became_open(self) -> None:
        self.release()

    def _stop(self) -> None:
        if self._openings is not None:
            self._openings.remove_publisher(self._goals_topic, self)
        self._is_free.set()

    async def _close(self) -> None:
        await self._native.close()

    async def _opened(self) -> None:
        await self._is_free.wait()
        if self.is_destroyed:
            raise self._why_closed()

    def _why_closed(self) -> InvalidHandle:
        return InvalidHandle(f"the client of action '{self.action_name}' is destroyed")


def _goals_topic(action: str) -> str:
    """The topic of the goals of an action, by its full name."""
    return request_topic(f"{action}/_action/send_goal")


def _as_bool(callback: Callable[[Any], Any] | None) -> Callable[[Any], Any] | None:
    """Make a callback of the bus from one of rclpy, which returns GoalResponse, CancelResponse or bool."""
    if callback is None:
        return None
    if is_async(callback):

        @wraps(callback)
        async def answer_async(subject: Any) -> bool:
            return _is_accepting(await callback(subject))

        return answer_async

    @wraps(callback)
    def answer(subject: Any) -> bool:
        return _is_accepting(callback(subject))

    return answer


def _is_accepting(response: object) -> bool:
    from bus_ros.rclpy.action import CancelResponse, GoalResponse  # late: few nodes have actions

    return (
        response in (GoalResponse.ACCEPT, CancelResponse.ACCEPT)
        if isinstance(response, GoalResponse | CancelResponse)
        else bool(response)
    )


async def _pass_on(goal: ClientGoal, callback: Callable[[Any], object]) -> None:
    """Call back for the feedback of a goal, until its end."""
    async for feedback in goal:
        outcome = callback(feedback)
        if asyncio.iscoroutine(outcome):
            await outcome
