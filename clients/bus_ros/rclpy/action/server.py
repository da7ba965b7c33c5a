"""Action servers: requests wait for an executor, which calls the program's callbacks.

Owns: the program's callbacks, the handles of its goals and their results. `bus_actions`, which native
programs use, too, has the states of goals and the selection of goals to cancel.
"""

import asyncio
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import partial
from threading import RLock
from typing import Any, Final

from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ConnectionClosed
from bus.service.server import RequestId
from bus_actions.action_type import ActionSupport, action_support
from bus_actions.endpoints import ServerEndpoints
from bus_actions.goal_state import GoalEvent, GoalStatus, InvalidTransition
from bus_actions.goal_table import Goal, GoalExists, GoalTable, TooManyGoals
from bus_ros.rclpy.action.entity import (
    FEEDBACK_QOS,
    ActionEntity,
    action_qos,
    check_action_name,
    check_action_type,
)
from bus_ros.rclpy.callback_groups import CallbackGroup
from bus_ros.rclpy.exceptions import InvalidHandle, RCLError
from bus_ros.rclpy.executors import await_or_execute
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from bus_ros.rclpy.service import MOST_WAITING
from bus_ros.rclpy.task import Future
from bus_ros.rclpy.waitable import NumberOfEntities

__all__ = [
    "ActionServer",
    "CancelResponse",
    "GoalEvent",
    "GoalResponse",
    "RCLError",
    "ServerGoalHandle",
    "default_cancel_callback",
    "default_goal_callback",
    "default_handle_accepted_callback",
]

_NS: Final = 1_000_000_000


class GoalResponse(Enum):
    """A goal callback's answer."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """A cancel callback's answer."""

    REJECT = 1
    ACCEPT = 2


class ServerGoalHandle:
    """An accepted goal; made by its server, passed to the program's callbacks."""

    def __init__(self, action_server: "ActionServer", goal_info: Any, goal_request: Any) -> None:
        """Raises RCLError if the server has such a goal already."""
        self._goal_handle: Goal | None = action_server._accept(goal_info)
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._feedback_message: Any = None
        self._lock = RLock()

    def __eq__(self, other: object) -> bool:
        # As in rclpy, a comparison with another type raises AttributeError.
        return bool(_same(self.goal_id, other.goal_id))  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(bytes(self.goal_id.uuid))

    @property
    def request(self) -> Any:
        """The goal message that the client sent."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """A UUID message."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self._goal_handle is not None and self._goal_handle.status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether a cancellation was accepted, and it has not ended yet."""
        return self.status == GoalStatus.CANCELING

    @property
    def status(self) -> int:
        """A number of action_msgs/msg/GoalStatus."""
        return int(GoalStatus.UNKNOWN if self._goal_handle is None else self._goal_handle.status)

    def execute(self, execute_callback: Callable[["ServerGoalHandle"], Any] | None = None) -> None:
        """Let the executor call `execute_callback`, or the server's."""
        # A goal may be canceled before it is executed; the program's callback is called nevertheless.
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback; raises TypeError for another class than the action's Feedback."""
        if not isinstance(feedback, self._action_server._action_type.Feedback):
            raise TypeError
        if self._goal_handle is not None:
            self._action_server._publish_feedback(self, feedback)

    # These raise RCLError if the goal's state does not allow it.

    def succeed(self) -> None:
        """End the goal as succeeded."""
        self._update_state(GoalEvent.SUCCEED)

    def abort(self) -> None:
        """End the goal as failed."""
        self._update_state(GoalEvent.ABORT)

    def canceled(self) -> None:
        """End the goal as canceled, after a cancellation was accepted."""
        self._update_state(GoalEvent.CANCELED)

    def destroy(self) -> None:
        """Forget the goal: from now on, methods do nothing."""
        self._goal_handle = None

    def _update_state(self, event: GoalEvent) -> None:
        with self._lock:
            if self._goal_handle is not None:
                self._action_server._advance(self._goal_handle, event)


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute the goal at once."""
    goal_handle.execute()


def default_goal_callback(goal_request: object) -> GoalResponse:
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: object) -> CancelResponse:
    """Reject every cancellation."""
    return CancelResponse.REJECT


class ActionServer(ActionEntity):
    """Serves an action; callbacks are `def` or `async def`. Results are kept for `result_timeout` seconds."""

    def __init__(  # noqa: PLR0913
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[ServerGoalHandle], Any],
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: Callable[[Any], Any] | None = default_goal_callback,
        handle_accepted_callback: Callable[[ServerGoalHandle], Any] | None = default_handle_accepted_callback,
        cancel_callback: Callable[[ServerGoalHandle], Any] | None = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile = FEEDBACK_QOS,
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 900,
    ) -> None:
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self.register_execute_callback(execute_callback)
        check_action_type(action_type)
        check_action_name(action_name, is_server=True)
        super().__init__(node, callback_group)
        self._logger = self._logger.get_child("action_server")
        self._action_type = action_type
        self._clock = node.get_clock()
        self._support: ActionSupport = action_support(action_type)
        self._table = GoalTable(round(result_timeout * _NS))
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self._result_futures: dict[bytes, Future[Any]] = {}
        self._expiry: asyncio.TimerHandle | None = None
        self._ends = ServerEndpoints()
        qos = action_qos(
            goal_service_qos_profile,
            result_service_qos_profile,
            cancel_service_qos_profile,
            feedback_pub_qos_profile,
            status_pub_qos_profile,
            is_server=True,
        )
        node._host_entity(
            self,
            lambda native: self._ends.open(
                native,
                self._support,
                action_name,
                qos,
                on_goal=partial(self._take, self._execute_goal_request, lambda: self._ends.goal),
                on_cancel=partial(self._take, self._execute_cancel_request, lambda: self._ends.cancel),
                on_result=partial(self._take, self._execute_get_result_request, lambda: self._ends.result),
            ),
        )

    @property
    def action_type(self) -> Any:
        """The class with Goal, Result and Feedback."""
        return self._action_type

    def get_num_entities(self) -> NumberOfEntities:
        """The numbers in rclpy's wait sets: three services and a timer."""
        return NumberOfEntities(num_services=3, num_timers=1)

    # --- callbacks; None restores the default

    def register_handle_accepted_callback(
        self, handle_accepted_callback: Callable[[ServerGoalHandle], Any] | None
    ) -> None:
        """Called with the handle of each accepted goal; the default executes it at once."""
        self._handle_accepted_callback = handle_accepted_callback or default_handle_accepted_callback

    def register_goal_callback(self, goal_callback: Callable[[Any], Any] | None) -> None:
        """Called with each goal message; returns a GoalResponse."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_cancel_callback(self, cancel_callback: Callable[[ServerGoalHandle], Any] | None) -> None:
        """Called with the handle of a goal to be canceled; returns a CancelResponse."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: Callable[[ServerGoalHandle], Any]) -> None:
        """Called with a goal's handle; returns the result. Raises TypeError if it is not callable."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    # --- for handles

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], Any] | None
    ) -> None:
        """Let the executor call `execute_callback`, or the server's."""
        callback = execute_callback or self._execute_callback
        with self._engine.loop:
            executor = self.node.own_executor
            if executor is None:  # the next executor of the node begins it
                self._put(self._begin_goal, callback, goal_handle)
        if executor is not None:
            executor.create_task(self._execute_goal, callback, goal_handle)

    def notify_goal_done(self) -> None:
        """Note the end of a goal: its result expires after its time, and after results of earlier ends."""
        if self._expiry is None or self._table.is_overfull:
            self._engine.post(self._expire)

    def destroy(self) -> None:
        """Leave the graph; from now on, methods of goals do nothing."""
        for goal_handle in self._goal_handles.values():
            goal_handle.destroy()
        with self._engine.loop:
            if self._expiry is not None:
                self._expiry.cancel()
            self._calls.clear()
        if not self._node._evict_entity(self, self._ends):
            raise ValueError("list.remove(x): x not in list")

    def _accept(self, goal_info: Any) -> Goal:
        with self._engine.loop:
            try:
                # As in rcl, not the time in the answer to the client, which is a little earlier.
                return self._table.accept(bytes(goal_info.goal_id.uuid), self._now_ns())
            except (GoalExists, TooManyGoals) as error:
                raise RCLError(f"Failed to accept new goal: {error}") from None

    def _advance(self, goal: Goal, event: GoalEvent) -> None:
        with self._engine.loop:
            try:
                self._table.advance(goal, event, self._now_ns())
            except InvalidTransition as error:
                raise RCLError(f"Failed to update goal state: {error}") from None
            self._publish_status()
        if goal.status.is_end:
            self.notify_goal_done()

    def _publish_feedback(self, goal_handle: ServerGoalHandle, feedback: Any) -> None:
        loop = self._engine.loop
        with loop.guard:
            message = goal_handle._feedback_message
            if message is None:  # one for all feedback: it is encoded at once
                message = self._support.feedback_message(goal_id=goal_handle.goal_id)
                goal_handle._feedback_message = message
            message._feedback = feedback  # its class was checked
            try:
                self._ends.feedback.publish(message)
            except ConnectionClosed:
                self._check_open()
        if loop.is_interrupted:
            loop.check()

    # --- requests, under the guard

    def _take(self, function: Any, end: Callable[[], Any], request: Any, request_id: RequestId) -> None:
        if len(self._calls) >= MOST_WAITING:
            text = "RuntimeError: too many requests wait: nobody spins the server"
            core_of(end()).answer(request_id, None, text)
        else:
            self._put(function, request, request_id)

    def _respond(self, respond: Callable[..., object], request_id: RequestId, response: Any) -> None:
        with self._engine.loop:
            try:
                respond(request_id, response)
            except BusError as error:
                respond(request_id, None, f"{type(error).__name__}: {error}")

    @contextmanager
    def _telling(self, end: Any, request_id: RequestId) -> Iterator[None]:
        """If a callback of the program raises, answer with the error: in ROS the client would never know."""
        try:
            yield
        except Exception as error:
            with self._engine.loop:
                core_of(end).refuse(request_id, error)
            raise

    def _publish_status(self) -> None:
        try:
            self._ends.status.publish_encoded(self._support.encoded_status(self._table.shown()))
        except ConnectionClosed:
            self._check_open()

    def _check_open(self) -> None:
        """After ConnectionClosed: does nothing if the server was destroyed, raises if only its node was."""
        if not self.is_destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested") from None

    def _now_ns(self) -> int:
        return self._clock.now().nanoseconds

    def _expire(self) -> None:
        now_ns = self._now_ns()
        gone = self._table.expire(now_ns)
        if gone:
            self._put(self._execute_expire_goals, [goal.id for goal in gone])
        due_ns = self._table.next_expiry_ns()
        if self._expiry is not None:
            self._expiry.cancel()
            self._expiry = None
        if due_ns is not None and not self.is_destroyed:
            delay_s = max(due_ns - now_ns, 0) / _NS
            self._expiry = self._engine.loop.call_later(delay_s, self._expire)

    # --- calls of the executor

    async def _execute_goal_request(self, request: Any, request_id: RequestId) -> None:
        goal_id = request.goal_id
        info = self._support.goal_info(goal_id=goal_id)
        with self._engine.loop:
            is_new = self._table.find(bytes(goal_id.uuid)) is None
        goal_handle: ServerGoalHandle | None = None
        with self._telling(self._ends.goal, request_id):
            is_wanted = is_new and await self._is_wanted(request.goal)
        if is_wanted:
            info.stamp = self._clock.now().to_msg()
            try:
                goal_handle = ServerGoalHandle(self, info, request.goal)
            except RuntimeError as error:
                self._logger.error(f"Failed to accept new goal with ID {goal_id.uuid}: {error}")
        response = self._support.send_goal.Response(accepted=goal_handle is not None, stamp=info.stamp)
        if goal_handle is not None:
            self._goal_handles[bytes(goal_id.uuid)] = goal_handle
            self._result_futures[bytes(goal_id.uuid)] = Future(executor=self.node.own_executor)
        self._respond(core_of(self._ends.goal).answer, request_id, response)
        if goal_handle is not None:
            if self._handle_accepted_callback is not default_handle_accepted_callback:
                with self._engine.loop:
                    self._publish_status()
            # The default executes the goal at once, which publishes a status that would replace this one.
            await await_or_execute(self._handle_accepted_callback, goal_handle)

    async def _is_wanted(self, goal: Any) -> bool:
        response = await await_or_execute(self._goal_callback, goal)
        if not isinstance(response, GoalResponse):
            self._logger.warning("Goal request callback did not return a GoalResponse type. Rejecting goal.")
        return response is GoalResponse.ACCEPT

    def _begin_goal(
        self, execute_callback: Callable[[ServerGoalHandle], Any], goal_handle: ServerGoalHandle
    ) -> None:
        """Execute the goal as a task, which does not hold the server's group."""
        self.notify_execute(goal_handle, execute_callback)

    async def _execute_goal(
        self, execute_callback: Callable[[ServerGoalHandle], Any], goal_handle: ServerGoalHandle
    ) -> None:
        # Now, because its result may expire at once.
        future = self._result_futures.get(bytes(goal_handle.goal_id.uuid))
        try:
            result = await await_or_execute(execute_callback, goal_handle)
        except Exception as error:
            result = self._action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
        if goal_handle.is_active:
            self._logger.warning(f"Goal state not set, assuming aborted. Goal ID: {goal_handle.goal_id.uuid}")
            goal_handle.abort()
        response = self._support.get_result.Response(status=goal_handle.status)
        try:
            response.result = result
        finally:  # if it is no result, the client gets an empty one, and the program the error
            if future is not None:
                future.set_result(response)

    async def _execute_cancel_request(self, request: Any, request_id: RequestId) -> None:
        info = request.goal_info
        with self._engine.loop:
            found = self._table.canceled_by(
                bytes(info.goal_id.uuid), info.stamp.sec * _NS + info.stamp.nanosec
            )
        response = self._support.cancel_goal.Response(return_code=int(found.code))
        for goal in found.goals:
            goal_handle = self._goal_handles.get(goal.id)
            if goal_handle is None:
                continue
            with self._telling(self._ends.cancel, request_id):
                answer = await await_or_execute(self._cancel_callback, goal_handle)
            if answer == CancelResponse.ACCEPT and self._cancel(goal_handle):
                response.goals_canceling.append(self._support.info_of(goal))
        self._respond(core_of(self._ends.cancel).answer, request_id, response)

    def _cancel(self, goal_handle: ServerGoalHandle) -> bool:
        """Whether it is canceled: it may have ended during the program's callback."""
        try:
            goal_handle._update_state(GoalEvent.CANCEL_GOAL)
        except RCLError as error:
            self._logger.debug(f"Failed to cancel goal in cancel callback: {error}")
            return False
        return True

    def _execute_get_result_request(self, request: Any, request_id: RequestId) -> None:
        future = self._result_futures.get(bytes(request.goal_id.uuid))
        if future is None:
            self._respond(self._ends.answer_result, request_id, self._support.get_result.Response())
            return
        future.call_when_done(lambda: self._respond(self._ends.answer_result, request_id, future.result()))

    def _execute_expire_goals(self, expired: list[bytes]) -> None:
        for goal_id in expired:
            goal_handle = self._goal_handles.pop(goal_id, None)
            if goal_handle is not None:
                goal_handle.destroy()
            self._result_futures.pop(goal_id, None)


def _same(one: Any, other: Any) -> bool:
    return bytes(one.uuid) == bytes(other.uuid)
