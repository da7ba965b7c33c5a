"""Action clients on asyncio: a goal is an object to iterate for feedback and to await for its result.

Owns: the goals sent, their known states, and the tasks that wait for them. Must not know: servers.
"""

import asyncio
from collections import deque
from types import TracebackType
from typing import Any, Final, Self
from uuid import uuid4

import msgspec

from bus.base.awaited import done_anyway, to_be_awaited
from bus.endpoint.endpoint import core_of
from bus.errors import (
    BusError,
    ConfigurationError,
    ConnectionClosed,
    LocalProtocolError,
    ServiceUnavailable,
    again,
)
from bus.names import validate_topic_name
from bus.node import Node
from bus.service.client_core import CallLost
from bus_actions.action_type import ActionSupport, action_support
from bus_actions.endpoints import ActionQoS, ClientEndpoints
from bus_actions.errors import ActionUnavailable, GoalAborted, GoalCanceled, GoalRejected
from bus_actions.goal_state import GoalStatus

__all__ = ["ActionClient", "ActionClientStatistics", "ClientGoal"]

_ID_BYTES: Final = 16
_MOST_FEEDBACK: Final = 1000
"""The most feedback messages of one goal that wait for the reader; above it, the oldest is dropped."""
_LEFT: Final = "its server has left before the goal's end"


class ActionClientStatistics(msgspec.Struct, frozen=True):
    """Totals of one client.

    For example:

        print(client.statistics().active)
    """

    sent: int
    """Goals sent."""
    accepted: int
    """Goals accepted."""
    rejected: int
    """Goals rejected."""
    ended: int
    """Goals with a received result or a departed server."""
    active: int
    """Goals accepted that have not ended."""
    feedback: int
    """Feedback received for its goals."""
    feedback_dropped: int
    """Feedback that newer feedback replaced before the program read it."""


class ClientGoal:
    """A goal that was accepted; made by `ActionClient.send_goal`.

    Iterate it for feedback: `async for feedback in goal` ends when the goal has ended, in any way. At most
    the newest 1000 unread feedback messages are kept.

        goal = await client.send_goal(Fibonacci.Goal(order=5))
        async for feedback in goal:
            print(feedback.sequence)
        result = await goal.result()
    """

    def __init__(self, client: "ActionClient", goal_id: bytes, request: Any) -> None:
        self.id = goal_id
        """16 bytes that no other goal has."""
        self.request = request
        """The Goal message."""
        self.status = GoalStatus.UNKNOWN
        """Its last known state."""
        self._client = client
        self._feedback: deque[Any] = deque()
        self._outcome: Any = None  # a response of get_result, or a BusError
        self._changed: asyncio.Future[None] | None = None

    def __repr__(self) -> str:
        return f"<ClientGoal {self.id.hex()} {self.status.name}>"

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Any:
        while not self._feedback:
            if self._outcome is not None:
                raise StopAsyncIteration
            await self._wait()
        return self._feedback.popleft()

    @property
    def is_done(self) -> bool:
        """Whether it has ended; `result` does not wait then."""
        return self._outcome is not None

    async def result(self) -> Any:
        """Wait for the end; returns the Result of a goal that succeeded. May be called repeatedly.

        Cancellation leaves the goal as it is: see `cancel`. Raises:

        - GoalAborted, GoalCanceled: each with the `result`, if there is one
        - ActionUnavailable: the server left before the end, or does not know the goal
        - ConnectionClosed: the client or its node is closed meanwhile
        """
        while self._outcome is None:
            await self._wait()
        outcome = self._outcome
        if isinstance(outcome, BusError):
            raise again(outcome)
        match GoalStatus(outcome.status):
            case GoalStatus.SUCCEEDED:
                return outcome.result
            case GoalStatus.CANCELED:
                raise GoalCanceled(self._client.name, outcome.result)
            case GoalStatus.ABORTED:
                raise GoalAborted(self._client.name, outcome.result)
        raise ActionUnavailable(self._client.name, "its server does not know the goal, or not any more")

    async def cancel(self) -> bool:
        """Ask the server to cancel it; returns whether the server accepts, or accepted before.

        The goal ends when `result` says so. Returns False if the server refuses or the goal has ended. Raises
        ActionUnavailable if the server leaves before it answers. After a cancellation of this call, the goal
        may still be canceled.
        """
        if self._outcome is not None:
            return False
        response = await self._client._cancel(self.id)
        is_canceled = any(bytes(info.goal_id.uuid) == self.id for info in response.goals_canceling)
        return is_canceled or self.status is GoalStatus.CANCELING

    # --- for the client

    def _take_feedback(self, feedback: Any) -> int:
        """Returns how many were dropped for it."""
        is_full = len(self._feedback) >= _MOST_FEEDBACK
        if is_full:
            self._feedback.popleft()
        self._feedback.append(feedback)
        self._notify()
        return is_full

    def _end(self, outcome: Any) -> None:
        if self._outcome is None:
            self._outcome = outcome
            if not isinstance(outcome, BusError):
                self.status = GoalStatus(outcome.status)
            self._notify()

    def _notify(self) -> None:
        if self._changed is not None and not self._changed.done():
            self._changed.set_result(None)
        self._changed = None

    async def _wait(self) -> None:
        if self._changed is None:
            self._changed = asyncio.get_running_loop().create_future()
        await asyncio.shield(self._changed)


class _Sent:
    """A goal sent but not yet answered, and the future of its answer, cancelled with the caller."""

    def __init__(self, goal: ClientGoal, answer: asyncio.Future[Any]) -> None:
        self.goal = goal
        self.answer = answer


class ActionClient:
    """Sends goals to the action `name`; use it as `async with ActionClient(node, Fibonacci, "fibonacci"):`.

    async with bus.Node("caller") as node, ActionClient(node, Fibonacci, "fibonacci") as client:
        await client.wait_for_server()
        goal = await client.send_goal(Fibonacci.Goal(order=5))
        print(await goal.result())
    """

    def __init__(self, node: Node, action_type: Any, name: str, *, qos: ActionQoS | None = None) -> None:
        validate_topic_name(name)
        self.name = name
        """The action's name as it was given; the full one once it is open."""
        self.type: Any = action_type
        """The class with `Goal`, `Result` and `Feedback`."""
        self._node = node
        self._support: ActionSupport = action_support(action_type)
        self._qos = qos or ActionQoS()
        self._ends: ClientEndpoints | None = None
        self._goals: dict[bytes, ClientGoal] = {}
        self._sent: dict[int, _Sent] = {}
        self._results: dict[int, ClientGoal] = {}
        self._cancels: dict[int, asyncio.Future[Any]] = {}
        self._counts = dict.fromkeys(
            ("sent", "accepted", "rejected", "ended", "feedback", "feedback_dropped"), 0
        )

    def __repr__(self) -> str:
        state = "" if self._ends is not None else "not open "
        return f"<ActionClient {state}{self.name} {self._support.name} goals={len(self._goals)}>"

    @to_be_awaited
    async def open(self) -> None:
        """Appear in the graph; `async with` does it.

        Raises the errors of `Node.create_client`. After a cancellation it is not open.
        """
        if self._ends is not None:
            raise LocalProtocolError(f"action client '{self.name}' is open already")
        ends = ClientEndpoints()
        await ends.open(
            self._node,
            self._support,
            self.name,
            self._qos,
            on_goal=self._take_answer,
            on_cancel=self._take_canceled,
            on_result=self._take_result,
            on_feedback=self._take_feedback,
            on_status=self._take_status,
        )
        self._ends = ends
        self.name = ends.action_name

    @done_anyway
    async def close(self) -> None:
        """Leave the graph. Goals continue; waiting calls get ConnectionClosed. Closing twice is allowed."""
        ends, self._ends = self._ends, None
        if ends is not None:
            await ends.close()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def server_is_ready(self) -> bool:
        """Whether a server would receive a goal now."""
        return self._ends is not None and self._ends.is_ready()

    async def wait_for_server(self) -> None:
        """Wait until a server exists; use `asyncio.timeout`.

        Raises ConnectionClosed if the client is closed meanwhile. Cancellation leaves nothing behind.
        """
        await self._opened().wait_until_ready()

    async def send_goal(self, goal: Any, *, goal_id: bytes | None = None) -> ClientGoal:
        """Send `goal` and wait until it is accepted; returns it, with feedback and result to come.

        `goal_id` is 16 bytes, random by default. Raises:

        - ActionUnavailable: no server exists, the server left before its answer, or its answer was lost with
          busd
        - GoalRejected: the server does not accept the goal
        - MessageTypeError: a message of another class
        - LocalProtocolError: 1000 goals are on their way

        After a cancellation, a goal that the server accepts nevertheless is canceled.
        """
        ends = self._opened()
        if goal_id is None:
            goal_id = uuid4().bytes
        elif len(goal_id) != _ID_BYTES:
            raise ConfigurationError(f"a goal's id has {_ID_BYTES} bytes, not {len(goal_id)}")
        if goal_id in self._goals:
            raise LocalProtocolError(f"goal {goal_id.hex()} was sent already")
        try:
            core_of(ends.goal).check_served()
        except ServiceUnavailable:
            raise ActionUnavailable(self.name, "no server exists now; see wait_for_server") from None
        support = self._support
        request = support.send_goal.Request(goal_id=support.goal_id(goal_id), goal=goal)
        sent = _Sent(ClientGoal(self, goal_id, goal), asyncio.get_running_loop().create_future())
        while not (number := ends.goal.send_request(request)):
            await core_of(ends.goal).requests.wait_for_room()
        self._sent[number] = sent
        self._goals[goal_id] = sent.goal  # feedback may come before the answer
        self._counts["sent"] += 1
        outcome = await sent.answer
        if isinstance(outcome, CallLost):
            raise ActionUnavailable(
                self.name,
                "busd, or a connection to it, has ended meanwhile, and the goal or its answer is lost",
            )
        if isinstance(outcome, ServiceUnavailable):
            raise ActionUnavailable(self.name, "its server has left before it answered")
        if isinstance(outcome, BusError):
            raise again(outcome)
        if not outcome.accepted:
            raise GoalRejected(self.name)
        return sent.goal

    def statistics(self) -> ActionClientStatistics:
        """Its counters until now; `close` keeps them."""
        return ActionClientStatistics(**self._counts, active=len(self._results))

    # --- inside

    def _opened(self) -> ClientEndpoints:
        if self._ends is None:
            raise ConnectionClosed(
                f"action client '{self.name}' is not open; use: async with ActionClient(...) as client"
            )
        return self._ends

    def _take_answer(self, number: int, outcome: Any) -> None:
        sent = self._sent.pop(number)
        goal = sent.goal
        is_accepted = not isinstance(outcome, BusError) and outcome.accepted
        if is_accepted:
            self._counts["accepted"] += 1
            goal.status = max(goal.status, GoalStatus.ACCEPTED)
            if sent.answer.cancelled():
                self._cancel_unwanted(goal.id)
            self._request_result(goal)
        else:
            self._counts["rejected"] += not isinstance(outcome, BusError)
            del self._goals[goal.id]
            if isinstance(outcome, CallLost):  # perhaps the server accepted it, unknown to this client
                self._cancel_unwanted(goal.id)
        if not sent.answer.done():
            sent.answer.set_result(outcome)

    def _request_result(self, goal: ClientGoal) -> None:
        support = self._support
        request = support.get_result.Request(goal_id=support.goal_id(goal.id))
        try:
            ends = self._opened()
            core_of(ends.result).check_served()
            number = ends.result.send_request(request)
        except ServiceUnavailable:
            self._end_goal(goal, self._without_result(goal))
            return
        except BusError as error:
            self._end_goal(goal, error)
            return
        if number:
            self._results[number] = goal
        else:
            self._end_goal(goal, LocalProtocolError(f"no room to ask action '{self.name}' for a result"))

    def _request_cancel(self, goal_id: bytes) -> int:
        support = self._support
        info = support.goal_info(goal_id=support.goal_id(goal_id))
        return self._opened().cancel.send_request(support.cancel_goal.Request(goal_info=info))

    def _cancel_unwanted(self, goal_id: bytes) -> None:
        """Request the end of a goal for which no call waits. If that fails, the goal continues."""
        try:
            number = self._request_cancel(goal_id)
        except BusError as error:
            number, reason = 0, f": {error}"
        else:
            reason = ": there is no room for the request"
        if not number:
            text = f"goal {goal_id.hex()} of action '{self.name}' can't be canceled{reason}"
            self._node.get_logger().warning(text)

    async def _cancel(self, goal_id: bytes) -> Any:
        while isinstance(outcome := await self._ask_to_cancel(goal_id), CallLost):
            pass  # a repeated request changes nothing
        if isinstance(outcome, ServiceUnavailable):
            raise ActionUnavailable(self.name, "its server has left before it answered")
        if isinstance(outcome, BusError):
            raise again(outcome)
        return outcome

    async def _ask_to_cancel(self, goal_id: bytes) -> Any:
        ends = self._opened()
        try:
            core_of(ends.cancel).check_served()
        except ServiceUnavailable:
            raise ActionUnavailable(self.name, _LEFT) from None
        while not (number := self._request_cancel(goal_id)):
            await core_of(ends.cancel).requests.wait_for_room()
        answer = self._cancels[number] = asyncio.get_running_loop().create_future()
        try:
            return await answer
        finally:
            self._cancels.pop(number, None)
            ends.cancel.forget(number)

    def _take_canceled(self, number: int, outcome: Any) -> None:
        answer = self._cancels.pop(number, None)
        if answer is not None and not answer.done():
            answer.set_result(outcome)

    def _take_result(self, number: int, outcome: Any) -> None:
        goal = self._results.pop(number, None)
        if goal is None:
            return
        if isinstance(outcome, CallLost):  # the goal is not
            self._request_result(goal)
            return
        if isinstance(outcome, ServiceUnavailable):
            outcome = self._without_result(goal)
        if self._ends is not None:  # its feedback was published before
            while (taken := self._ends.feedback.take()) is not None:
                self._take_feedback(taken[0])
        self._end_goal(goal, outcome)

    def _without_result(self, goal: ClientGoal) -> Any:
        """The outcome of a goal after its server has left: its status may tell the end."""
        if goal.status not in (GoalStatus.ABORTED, GoalStatus.CANCELED):
            return ActionUnavailable(self.name, _LEFT)
        response = self._support.get_result.Response()
        response.status = int(goal.status)
        return response

    def _end_goal(self, goal: ClientGoal, outcome: Any) -> None:
        self._counts["ended"] += 1
        self._goals.pop(goal.id, None)
        goal._end(outcome)

    def _take_feedback(self, message: Any) -> None:
        goal = self._goals.get(bytes(message.goal_id.uuid))
        if goal is not None:
            self._counts["feedback"] += 1
            self._counts["feedback_dropped"] += goal._take_feedback(message.feedback)

    def _take_status(self, message: Any) -> None:
        for one in message.status_list:
            goal = self._goals.get(bytes(one.goal_info.goal_id.uuid))
            if goal is not None:
                goal.status = max(goal.status, GoalStatus(one.status))
