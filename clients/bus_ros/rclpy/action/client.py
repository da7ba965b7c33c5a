"""Action clients: they send goals; an executor takes answers, feedback and states.

Owns: the futures of goals, results and cancellations, and the program's callbacks for feedback.
"""

import uuid
import weakref
from collections import Counter, OrderedDict, deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Final

from bus.endpoint.endpoint import core_of
from bus.errors import BusError, ServiceUnavailable
from bus.service.client_core import CallLost
from bus_actions.action_type import ActionSupport, action_support
from bus_actions.endpoints import ClientEndpoints
from bus_actions.errors import ActionUnavailable
from bus_actions.goal_state import GoalStatus as State
from bus_ros.engine import Waiter, deadline_after
from bus_ros.entity import Work
from bus_ros.rclpy.action.entity import (
    FEEDBACK_QOS,
    ActionEntity,
    action_qos,
    check_action_name,
    check_action_type,
)
from bus_ros.rclpy.callback_groups import CallbackGroup
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from bus_ros.rclpy.task import Answer, Future
from bus_ros.rclpy.waitable import NumberOfEntities

__all__ = ["ActionClient", "ClientGoalHandle", "GoalStatus"]  # noqa: F822 - made by __getattr__

_LEFT: Final = "its server has left before it answered"
_LOST: Final = "busd, or a connection to it, has ended meanwhile, and the request or its answer is lost"
_UNKNOWN: Final = int(State.UNKNOWN)
_MOST_ENDED: Final = 100
"""The most feedback callbacks kept of goals without a result that have ended, or whose request was cancelled:
feedback may still arrive."""
_ENDS: Final = frozenset(int(state) for state in State if state.is_end)


class ClientGoalHandle:
    """A goal that a server has answered; the result of the future of `send_goal_async`."""

    def __init__(self, action_client: "ActionClient", goal_id: Any, goal_response: Any) -> None:
        self._action_client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status = _UNKNOWN

    def __eq__(self, other: object) -> bool:
        # As in rclpy, a comparison with another type raises AttributeError.
        return bool(self._goal_id == other.goal_id)  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(bytes(self._goal_id.uuid))

    def __repr__(self) -> str:
        return f"ClientGoalHandle <id={self.goal_id.uuid}, accepted={self.accepted}, status={self.status}>"

    @property
    def goal_id(self) -> Any:
        """A UUID message."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """The time of its acceptance."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        """Whether the server accepted it."""
        return bool(self._goal_response.accepted)

    @property
    def status(self) -> int:
        """A number of action_msgs/msg/GoalStatus; it changes while an executor works for the client."""
        return self._status

    def cancel_goal(self) -> Any:
        """Ask the server to cancel it, and wait for the answer."""
        return self._action_client._cancel_goal(self)

    def cancel_goal_async(self) -> Future[Any]:
        """Ask the server to cancel it; returns a future for the answer."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Wait for the result, with the status."""
        return self._action_client._get_result(self)

    def get_result_async(self) -> Future[Any]:
        """A future for the result, with the status.

        Its exception is ActionUnavailable if the server leaves before the goal's end.
        """
        return self._action_client._get_result_async(self)


class ActionClient(ActionEntity):
    """Sends goals to an action's server."""

    def __init__(  # noqa: PLR0913
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile = FEEDBACK_QOS,
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
    ) -> None:
        check_action_type(action_type)
        check_action_name(action_name, is_server=False)
        super().__init__(node, callback_group)
        self._logger = self._logger.get_child("action_client")
        self._action_type = action_type
        self._action_name = action_name
        self._support: ActionSupport = action_support(action_type)
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle]] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        self._ended: OrderedDict[bytes, None] = OrderedDict()  # goals whose callback is kept nevertheless
        self._pending_goal_requests: dict[int, tuple[Future[Any], Any, bytes]] = {}
        self._unanswered: Counter[bytes] = Counter()  # the same goals
        self._early_feedback: dict[bytes, deque[Any]] = {}  # of goals without an answer yet
        self._pending_cancel_requests: dict[int, tuple[Future[Any]]] = {}
        self._pending_result_requests: dict[int, tuple[Future[Any], Any]] = {}
        self._waiters: list[Waiter] = []  # threads in waiting calls
        self._ends = ClientEndpoints()
        qos = action_qos(
            goal_service_qos_profile,
            result_service_qos_profile,
            cancel_service_qos_profile,
            feedback_sub_qos_profile,
            status_sub_qos_profile,
            is_server=False,
        )
        node._host_entity(
            self,
            lambda native: self._ends.open(
                native,
                self._support,
                action_name,
                qos,
                on_goal=self._on_goal,
                on_cancel=self._on_cancel,
                on_result=self._on_result,
                on_feedback=None,
                on_status=None,
            ),
        )
        with self._engine.loop:
            self._begin_to_hear()
            self.notify()  # for earlier arrivals

    def _begin_to_hear(self) -> None:
        for subscription in (self._ends.feedback, self._ends.status):
            subscription.set_arrival_callback(self.notify)

    def get_num_entities(self) -> NumberOfEntities:
        """The numbers in rclpy's wait sets: two subscriptions and three clients."""
        return NumberOfEntities(num_subs=2, num_clients=3)

    # --- calls

    def send_goal(self, goal: Any, **kwargs: Any) -> Any:
        """Send a goal and wait for its result; arguments as for `send_goal_async`.

        Feedback needs an executor that works for the node, in another thread. Raises TypeError if `goal` is
        not a Goal of the action, ActionUnavailable if the server leaves before the end.
        """
        goal_handle = self._wait(self.send_goal_async(goal, **kwargs))
        return self._get_result(goal_handle)

    def send_goal_async(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], Any] | None = None,
        goal_uuid: Any = None,
    ) -> Future[Any]:
        """Send a goal; returns a future for a ClientGoalHandle, which says whether it is accepted.

        Raises TypeError if `goal` is not a Goal of the action, InvalidHandle after the client, or its node,
        was destroyed.
        """
        if not isinstance(goal, self._action_type.Goal):
            raise TypeError
        goal_id = self._generate_random_uuid() if goal_uuid is None else goal_uuid
        request = self._support.send_goal.Request(goal_id=goal_id, goal=goal)
        future = self._future(self._drop_goal)
        key = bytes(goal_id.uuid)
        with self._engine.loop:
            number = self._send(self._ends.goal, request)
            self._pending_goal_requests[number] = future, goal_id, key
            self._unanswered[key] += 1
            if feedback_callback is not None:
                self._feedback_callbacks[key] = feedback_callback
                self._ended.pop(key, None)  # an earlier goal may have had this id
        return future

    def server_is_ready(self) -> bool:
        """Whether a server exists."""
        with self._engine.loop:
            return not self.is_destroyed and self._ends.is_ready()

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait for a server, at most `timeout_sec` (None: for ever); returns whether one exists."""
        with suppress(TimeoutError, BusError):
            self._engine.run(self._ends.wait_until_ready, timeout_sec, context=self.node.context)
        return self.server_is_ready()

    def destroy(self) -> None:
        """Leave the graph; unfinished futures stay so."""
        if not self._node._evict_entity(self, self._ends):
            raise ValueError("list.remove(x): x not in list")

    def _generate_random_uuid(self) -> Any:
        return self._support.goal_id(uuid.uuid4().bytes)

    def _cancel_goal(self, goal_handle: ClientGoalHandle) -> Any:
        return self._wait(self._cancel_goal_async(goal_handle))

    def _cancel_goal_async(self, goal_handle: ClientGoalHandle) -> Future[Any]:
        _check_handle(goal_handle)
        request = self._support.cancel_goal.Request()
        request.goal_info.goal_id = goal_handle.goal_id
        future = self._future(partial(self._drop, self._ends.cancel, self._pending_cancel_requests))
        with self._engine.loop:
            if self._is_served(self._ends.cancel, future):
                self._pending_cancel_requests[self._send(self._ends.cancel, request)] = (future,)
        return future

    def _get_result(self, goal_handle: ClientGoalHandle) -> Any:
        return self._wait(self._get_result_async(goal_handle))

    def _get_result_async(self, goal_handle: ClientGoalHandle) -> Future[Any]:
        _check_handle(goal_handle)
        future = self._future(partial(self._drop, self._ends.result, self._pending_result_requests))
        with self._engine.loop:
            self._ask_for_result(future, goal_handle.goal_id)
        return future

    # --- inside

    def _future(self, drop: Callable[[Future[Any]], object]) -> Answer[Any]:
        future: Answer[Any] = Answer(executor=self.node.own_executor)
        future.drop = drop
        return future

    def _drop(self, end: Any, pending: dict[int, Any], future: Future[Any]) -> Any:
        """Ignore the answer of a pending request; returns what was kept for it, None if it has an answer."""
        with self._engine.loop:
            for number, one in tuple(pending.items()):
                if one[0] is future:
                    end.forget(number)
                    return pending.pop(number, None)
        return None

    def _drop_goal(self, future: Future[Any]) -> None:
        if (pending := self._drop(self._ends.goal, self._pending_goal_requests, future)) is not None:
            self._count_answer(pending[2])
            self._hand_early_feedback(pending[2])
            if pending[2] in self._feedback_callbacks:  # its goal may have been refused
                self._note_end(pending[2])

    # --- inside, under the guard

    def _ask_for_result(self, future: Future[Any], goal_id: Any) -> None:
        if self._is_served(self._ends.result, future):
            request = self._support.get_result.Request(goal_id=goal_id)
            self._pending_result_requests[self._send(self._ends.result, request)] = future, goal_id

    def _send(self, end: Any, request: Any) -> int:
        if self.is_destroyed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")
        number: int = end.send_request(request)
        if not number:
            raise RuntimeError(f"no room to send a request of action '{self._action_name}'")
        return number

    def _is_served(self, end: Any, future: Future[Any]) -> bool:
        """Whether there is still a server; otherwise the future gets the error."""
        try:
            core_of(end).check_served()
        except ServiceUnavailable:
            self._put(_finish, future, self._unavailable())
            return False
        return True

    def _unavailable(self, why: str = _LEFT) -> ActionUnavailable:
        return ActionUnavailable(self._ends.action_name, why)

    def _on_goal(self, number: int, outcome: Any) -> None:
        self._put_answer(self._finish_goal, number, outcome)

    def _on_cancel(self, number: int, outcome: Any) -> None:
        self._put_answer(self._finish_cancel, number, outcome)

    def _on_result(self, number: int, outcome: Any) -> None:
        if isinstance(outcome, CallLost) and not self.is_destroyed:  # the goal is not lost: ask again
            self._ask_for_result(*self._pending_result_requests.pop(number))
            return
        self._put_answer(self._finish_result, number, outcome)

    def _put_answer(self, function: Any, number: int, outcome: Any) -> None:
        if isinstance(outcome, ServiceUnavailable):
            outcome = self._unavailable(_LOST if isinstance(outcome, CallLost) else _LEFT)
        self._put(function, number, outcome)
        for waiter in self._waiters:
            waiter.set()

    def take(self, most: int) -> Work | None:
        self.is_single = False
        if self._calls and self._calls[0][0] != self._finish_result:
            call = self._calls.popleft()
            # The callbacks of the goal's future come before its feedback, so this is queued again behind
            # them.
            self.is_single = call[0] == self._finish_goal
            return call
        while (
            taken := core_of(self._ends.feedback).receiver.take()
        ) is not None:  # feedback was published before the result
            key = bytes(taken[0].goal_id.uuid)
            if key in self._unanswered:  # it may overtake the answer, which is on another topic
                self._early_feedback.setdefault(key, deque(maxlen=FEEDBACK_QOS.depth)).append(taken[0])
                continue
            callback = self._feedback_callbacks.get(key)
            if callback is not None:
                return callback, taken[:1]
        if (taken := core_of(self._ends.status).receiver.take()) is not None:
            return self._apply_status, taken[:1]
        return super().take(most)

    # --- calls of the executor, or of a waiting thread

    def _finish_goal(self, number: int, outcome: Any) -> None:
        if (pending := self._pending_goal_requests.pop(number, None)) is None:
            return  # cancelled meanwhile
        future, goal_id, key = pending
        self._count_answer(key)
        try:
            self._answer_goal(future, goal_id, key, outcome)
        finally:
            self._hand_early_feedback(key)

    def _count_answer(self, key: bytes) -> None:
        with self._engine.loop:
            self._unanswered[key] -= 1
            if not self._unanswered[key]:
                del self._unanswered[key]

    def _hand_early_feedback(self, key: bytes) -> None:
        with self._engine.loop:
            callback = self._feedback_callbacks.get(key)
            for message in self._early_feedback.pop(key, ()):
                if callback is not None:
                    self._put(callback, message)
            self.notify()

    def _answer_goal(self, future: Future[Any], goal_id: Any, key: bytes, outcome: Any) -> None:
        if isinstance(outcome, BusError):
            self._forget_feedback(key)
            future.set_exception(outcome)
            return
        goal_handle = ClientGoalHandle(self, goal_id, outcome)
        if goal_handle.accepted:
            if key in self._goal_handles:
                raise RuntimeError(f"Two goals were accepted with the same ID ({goal_handle})")
            self._goal_handles[key] = weakref.ref(goal_handle)
            # As in rclpy, a status that has arrived together with the answer is known from the start.
            with self._engine.loop:
                while (taken := core_of(self._ends.status).receiver.take()) is not None:
                    self._apply_status(taken[0])
        else:
            self._forget_feedback(key)
        future.set_result(goal_handle)

    def _finish_cancel(self, number: int, outcome: Any) -> None:
        if (pending := self._pending_cancel_requests.pop(number, None)) is not None:
            _finish(pending[0], outcome)

    def _finish_result(self, number: int, outcome: Any) -> None:
        if (pending := self._pending_result_requests.pop(number, None)) is not None:
            self._forget_feedback(bytes(pending[1].uuid))
            _finish(pending[0], outcome)

    def _apply_status(self, message: Any) -> None:
        if not self._goal_handles and len(self._ended) == len(self._feedback_callbacks):
            return
        for one in message.status_list:
            key = one.goal_info.goal_id.uuid
            if key in self._feedback_callbacks and one.status in _ENDS:
                self._note_end(key)
            reference = self._goal_handles.get(key)
            if reference is None:
                continue
            goal_handle = reference()
            if goal_handle is not None:
                goal_handle._status = one.status
            if goal_handle is None or one.status in _ENDS:
                del self._goal_handles[key]

    def _note_end(self, key: bytes) -> None:
        """Keep the goal's feedback callback only until a number of others have ended."""
        self._ended[bytes(key)] = None
        if len(self._ended) > _MOST_ENDED:
            oldest, _ = self._ended.popitem(last=False)
            self._feedback_callbacks.pop(oldest, None)

    def _forget_feedback(self, key: bytes) -> None:
        self._feedback_callbacks.pop(key, None)
        self._ended.pop(key, None)

    # --- inside, without the guard

    def _wait(self, future: Future[Any]) -> Any:
        """Wait until the future is done, with or without a spinning thread. Raises the future's exception."""
        mover = self._engine
        with mover.loop:
            waiter = Waiter(mover, self.node.context)
            self._waiters.append(waiter)
        future.call_when_done(lambda: mover.call(waiter.set))
        try:
            while not future.done() and self.node.context.ok():
                with mover.loop:
                    waiter.is_set = future.done()
                    call = self._next_answer()
                    if call is None:
                        waiter.wait(deadline_after(None))
                if call is not None:
                    call[0](*call[1])
        finally:
            with mover.loop:
                self._waiters.remove(waiter)
        return future.result()

    def _next_answer(self) -> Any:
        """The next call, if no executor works for the node to make it."""
        executor = self.node.own_executor
        if executor is not None and executor.is_looking():
            return None
        return self._calls.popleft() if self._calls else None


def _finish(future: Future[Any], outcome: Any) -> None:
    if future.done():
        return  # cancelled meanwhile
    if isinstance(outcome, BusError):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)


def _check_handle(goal_handle: object) -> None:
    if not isinstance(goal_handle, ClientGoalHandle):
        raise TypeError(f"Expected type ClientGoalHandle but received {type(goal_handle)}")


def __getattr__(name: str) -> Any:
    if name == "GoalStatus":  # a message class, made at its first use as all of them
        from bus_ros.rosidl import message_class

        return message_class("action_msgs/msg/GoalStatus")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
