"""Action servers on asyncio: each goal is a task, and a canceled goal is a task that is cancelled.

Owns: the goals' results, and the requests that wait for them. `goal_state` has the order of states,
`goal_table` the goals that a cancel request means, `executions` the tasks of goals.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import aclosing, contextmanager, suppress
from time import monotonic_ns
from types import TracebackType
from typing import Any, Final, Literal, Self

import msgspec

from bus.base.awaited import done_anyway, to_be_awaited
from bus.base.callbacks import call_async, is_async
from bus.diagnostics.slow_callback import watched
from bus.endpoint.endpoint import core_of
from bus.errors import (
    BusError,
    ConfigurationError,
    ConnectionClosed,
    LocalProtocolError,
    MessageTypeError,
)
from bus.names import validate_topic_name
from bus.node import Node
from bus.node.node import report_error
from bus.service.server import RequestId
from bus.types.support import type_support
from bus_actions.action_type import ActionSupport, action_support
from bus_actions.endpoints import ActionQoS, ServerEndpoints
from bus_actions.executions import Executions
from bus_actions.goal_state import GoalEvent, GoalStatus
from bus_actions.goal_table import CancelCode, Goal, GoalExists, GoalTable, TooManyGoals

__all__ = ["ActionServer", "ActionServerStatistics", "ServerGoal"]

_MOST_WAITING: Final = 1000
"""The most requests that may wait for the result of one goal."""
_LONGEST_S: Final = 1e9
"""A longer `result_timeout`, also an infinite one, counts as this."""
_NS: Final = 1_000_000_000


class ActionServerStatistics(msgspec.Struct, frozen=True):
    """Totals of one server.

    For example:

        print(server.statistics().active)
    """

    accepted: int
    """Goals accepted."""
    rejected: int
    """Goals refused: by the callback, or because their id was known, or too many were active."""
    succeeded: int
    """Goals that have succeeded."""
    canceled: int
    """Goals that were canceled."""
    aborted: int
    """Goals aborted."""
    active: int
    """Goals that have not ended."""
    feedback: int
    """Feedback published."""


class ServerGoal:
    """A goal that an action server has accepted; passed to `execute`.

    async def execute(goal):
        yield Count.Feedback(current=1)
        yield Count.Result(reached=goal.request.target)
    """

    def __init__(self, server: "ActionServer", record: Goal, request: Any) -> None:
        self.request = request
        """The Goal message that the client sent."""
        self._server = server
        self._record = record
        self._result: Any = None
        self._response: Any = None  # since the end
        self._waiting: list[RequestId] = []
        self._is_given_up = False

    def __repr__(self) -> str:
        return f"<ServerGoal {self.id.hex()} {self.status.name}>"

    @property
    def id(self) -> bytes:
        """16 bytes that the client has chosen."""
        return self._record.id

    @property
    def status(self) -> GoalStatus:
        """Its state."""
        return self._record.status

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self._record.status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether a cancellation was accepted and the goal has not ended yet."""
        return self._record.status is GoalStatus.CANCELING

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback to the clients, as `yield` of a Feedback does.

        Publishes nothing after the goal's end. Raises MessageTypeError for another class.
        """
        self._server._publish_feedback(self, feedback)

    def succeed(self, result: Any = None) -> None:
        """End it as succeeded, as `yield` of a Result does unless the goal is canceled.

        The client gets `result`, by default the Result that `execute` still returns or yields. Raises
        InvalidTransition if the goal has ended, MessageTypeError for a class other than the action's Result.
        """
        self._end(GoalEvent.SUCCEED, result)

    def abort(self, result: Any = None) -> None:
        """End it as aborted. Arguments and errors as in `succeed`.

        May be called outside `execute`, too. This does not stop `execute`: the goal stays aborted, and its
        clients get the result when `execute` has ended.
        """
        self._end(GoalEvent.ABORT, result)

    def canceled(self, result: Any = None) -> None:
        """End it as canceled. Raises InvalidTransition if no cancellation was accepted; otherwise as
        `succeed`."""
        self._end(GoalEvent.CANCELED, result)

    def _end(self, event: GoalEvent, result: Any) -> None:
        if result is not None:
            self._server._check_result(result)
        self._server._advance(self, event)
        if result is not None:
            self._result = result


class ActionServer:
    """Serves the action `name`; use it as `async with ActionServer(node, Fibonacci, "fibonacci", execute):`.

    `execute` is called with a `ServerGoal` for each accepted goal. As an async generator it yields Feedback,
    and at its end a Result: the goal has succeeded. As an `async def` without a `yield` it returns the
    Result. If `execute` ends without a Result or raises an exception, the goal is aborted. The exception then
    leaves the node like one in any callback.

    `goal_callback`, `def` or `async def`, gets the Goal message and returns whether it is accepted; by
    default all are. `cancel_callback` gets the ServerGoal and returns whether it may be canceled; by default
    all may. A cancellation raises `asyncio.CancelledError` in `execute`, at an `await`. If `execute` then
    still yields a Result, that is the result until then.

    Up to `at_once` goals are executed concurrently; the others wait in order. Results are kept for
    `result_timeout` seconds, at most 1000 results. Raises ConfigurationError for a bad name, `at_once` below
    1 or `result_timeout` below 0, MessageTypeError if the class does not define an action.

        async with bus.Node("counter") as node, ActionServer(node, Count, "count", execute):
            await node.spin()
    """

    def __init__(  # noqa: PLR0913
        self,
        node: Node,
        action_type: Any,
        name: str,
        execute: Callable[[ServerGoal], Any],
        *,
        goal_callback: Callable[[Any], Any] | None = None,
        cancel_callback: Callable[[ServerGoal], Any] | None = None,
        at_once: int = 100,
        result_timeout: float = 900.0,
        qos: ActionQoS | None = None,
    ) -> None:
        validate_topic_name(name)
        if at_once < 1:
            raise ConfigurationError(f"at_once must be at least 1, not {at_once}: no goal would be executed")
        if not result_timeout >= 0:
            raise ConfigurationError(f"result_timeout must be at least 0 s, not {result_timeout}")
        self.name = name
        """The action's name as it was given; the full one once it is open."""
        self.type: Any = action_type
        """The class with `Goal`, `Result` and `Feedback`."""
        self._node = node
        self._support: ActionSupport = action_support(action_type)
        what, logger = f"action '{name}'", node.get_logger()
        self._execute = watched(execute, what, logger)
        self._goal_callback = goal_callback and watched(goal_callback, what, logger)
        self._cancel_callback = cancel_callback and watched(cancel_callback, what, logger)
        self._qos = qos or ActionQoS()
        self._table = GoalTable(round(min(result_timeout, _LONGEST_S) * _NS))
        self._goals: dict[bytes, ServerGoal] = {}
        self._executions = Executions(at_once, self._begin, self._settle_unfinished)
        self._early: list[tuple[Callable[[Any, RequestId], Any], Any, RequestId]] = []
        self._ends: ServerEndpoints | None = None
        self._expiry: asyncio.TimerHandle | None = None
        self._is_status_due = False
        self._is_stopped = False
        self._counts = dict.fromkeys(
            ("accepted", "rejected", "succeeded", "canceled", "aborted", "feedback"), 0
        )

    def __repr__(self) -> str:
        state = "" if self._ends is not None else "not open "
        return f"<ActionServer {state}{self.name} {self._support.name} goals={len(self._table.active())}>"

    @property
    def goals(self) -> list[ServerGoal]:
        """The goals that have not ended, in their order of arrival."""
        return [self._goals[goal.id] for goal in self._table.active()]

    @to_be_awaited
    async def open(self) -> None:
        """Appear in the graph; `async with` does it. On return, existing clients can send goals.

        Raises the errors of `Node.create_service`. After a cancellation it is not open.
        """
        if self._ends is not None:
            raise LocalProtocolError(f"action server '{self.name}' is open already")
        self._is_stopped = False
        ends = ServerEndpoints()
        try:
            await ends.open(
                self._node,
                self._support,
                self.name,
                self._qos,
                on_goal=self._take_goal_async if _is_async(self._goal_callback) else self._take_goal,
                on_cancel=self._take_cancel_async if _is_async(self._cancel_callback) else self._take_cancel,
                on_result=self._take_result,
                on_end=self._stop,
            )
        except BaseException:
            self._early.clear()
            raise
        self._ends = ends
        self.name = ends.action_name
        early, self._early = self._early, []
        for function, request, request_id in early:
            try:
                outcome = function(request, request_id)
                if outcome is not None:
                    await outcome
            except Exception as error:
                report_error(self._node, error)
            except BaseException:
                await self.close()
                raise

    @done_anyway
    async def close(self) -> None:
        """Accept no more goals. Goals in execution are cancelled and end as aborted; clients are notified.

        Closing twice is allowed. After a cancellation it is closed; clients may only notice that the server
        is gone.
        """
        ends = self._ends
        if ends is None:
            return
        try:
            await ends.goal.close()
            self._stop()
            await self._executions.wait()
        finally:
            if self._is_status_due:
                self._publish_status_now()
            self._ends = None
            await ends.close()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    def statistics(self) -> ActionServerStatistics:
        """Its counters until now; `close` keeps them."""
        return ActionServerStatistics(**self._counts, active=len(self._table.active()))

    # --- goals that come

    def _is_early(
        self, function: Callable[[Any, RequestId], Any], request: Any, request_id: RequestId
    ) -> bool:
        """Whether a request came before `open` returned. If so, it waits until `open` has returned."""
        is_early = self._ends is None and not self._is_stopped
        if is_early:
            self._early.append((function, request, request_id))
        return is_early

    def _take_goal(self, request: Any, request_id: RequestId) -> None:
        if self._is_early(self._take_goal, request, request_id):
            return
        is_new = self._table.find(bytes(request.goal_id.uuid)) is None
        with self._telling("goal", request_id):
            is_wanted = is_new and (self._goal_callback is None or bool(self._goal_callback(request.goal)))
        self._answer_goal(request, request_id, is_wanted=is_wanted)

    async def _take_goal_async(self, request: Any, request_id: RequestId) -> None:
        if self._is_early(self._take_goal_async, request, request_id):
            return
        assert self._goal_callback is not None
        is_new = self._table.find(bytes(request.goal_id.uuid)) is None
        with self._telling("goal", request_id):
            is_wanted = is_new and bool(await call_async(self._goal_callback, request.goal))
        self._answer_goal(request, request_id, is_wanted=is_wanted)

    @contextmanager
    def _telling(self, end: Literal["goal", "cancel"], request_id: RequestId) -> Iterator[None]:
        """Notify the client if a callback of the program raises; the exception then leaves as any
        callback's."""
        try:
            yield
        except Exception as error:
            if self._ends is not None:
                service = self._ends.goal if end == "goal" else self._ends.cancel
                core_of(service).refuse(request_id, error)
            raise

    def _answer_goal(self, request: Any, request_id: RequestId, *, is_wanted: bool) -> None:
        if self._ends is None or self._is_stopped:
            return
        response = self._support.send_goal.Response()
        record: Goal | None = None
        if is_wanted:
            try:
                now = self._node.now()
                record = self._table.accept(bytes(request.goal_id.uuid), now.sec * _NS + now.nanosec)
            except GoalExists:  # while the callback was asked
                pass
            except TooManyGoals as error:
                self._node.get_logger().warning(f"action '{self.name}' rejects a goal: {error}")
        if record is None:
            self._counts["rejected"] += 1
            core_of(self._ends.goal).answer(request_id, response)
            return
        self._counts["accepted"] += 1
        response.accepted = True
        response.stamp.sec, response.stamp.nanosec = divmod(record.stamp_ns, _NS)
        core_of(self._ends.goal).answer(request_id, response)
        goal = self._goals[record.id] = ServerGoal(self, record, request.goal)
        self._publish_status()
        self._executions.add(goal)

    # --- executing

    def _begin(self, goal: ServerGoal) -> asyncio.Task[None]:
        self._advance(goal, GoalEvent.EXECUTE)
        return asyncio.get_running_loop().create_task(
            self._run(goal), name=f"goal {goal.id.hex()} of {self.name}"
        )

    async def _run(self, goal: ServerGoal) -> None:
        try:
            work = self._execute(goal)
            if isinstance(work, AsyncGenerator):
                await self._follow(goal, work)
            else:
                self._take_outcome(goal, await work)
        except asyncio.CancelledError:
            if goal.is_cancel_requested:
                goal.canceled()
        except Exception as error:
            report_error(self._node, error)
        finally:
            self._settle(goal)

    async def _follow(self, goal: ServerGoal, work: AsyncGenerator[Any, None]) -> None:
        async with aclosing(work):
            async for item in work:
                if isinstance(item, self._support.result):
                    self._take_outcome(goal, item)
                    return
                goal.publish_feedback(item)

    def _take_outcome(self, goal: ServerGoal, result: Any) -> None:
        if result is None:
            return
        self._check_result(result)
        if goal.is_active:
            self._advance(goal, _end_of(goal))
        if goal._result is None:
            goal._result = result

    def _settle(self, goal: ServerGoal) -> None:
        """Its execution has ended: send the result to the waiting clients."""
        if goal.is_active:
            if goal.status is GoalStatus.ACCEPTED:  # it was never begun
                self._advance(goal, GoalEvent.EXECUTE)
            self._advance(goal, GoalEvent.ABORT)
        response = self._support.get_result.Response()
        response.status = int(goal.status)
        if goal._result is not None:
            response.result = goal._result
        goal._response = response
        waiting, goal._waiting = goal._waiting, []
        for request_id in waiting:
            self._send_result(request_id, response)
        self._expire()

    def _settle_unfinished(self, goal: ServerGoal) -> None:
        """Its task has ended. A task that was cancelled before its first step has not run `_run` at all."""
        if goal._response is None:
            if goal.is_cancel_requested:
                goal.canceled()
            self._settle(goal)

    def _stop(self, reason: BusError | None = None) -> None:
        """No more goals can arrive: abort the existing ones."""
        self._is_stopped = True
        if self._expiry is not None:
            self._expiry.cancel()
        waiting, running = self._executions.stop()
        for goal in waiting:
            self._settle(goal)
        for goal in running:
            goal._is_given_up = True

    # --- cancel requests

    def _take_cancel(self, request: Any, request_id: RequestId) -> None:
        if self._is_early(self._take_cancel, request, request_id):
            return
        code, asked = self._find_canceled(request)
        with self._telling("cancel", request_id):
            agreed = [one for one in asked if self._cancel_callback is None or self._cancel_callback(one)]
        self._answer_cancel(request_id, CancelCode.REJECTED if asked and not agreed else code, agreed)

    async def _take_cancel_async(self, request: Any, request_id: RequestId) -> None:
        if self._is_early(self._take_cancel_async, request, request_id):
            return
        assert self._cancel_callback is not None
        code, asked = self._find_canceled(request)
        with self._telling("cancel", request_id):
            agreed = [one for one in asked if await call_async(self._cancel_callback, one)]
        self._answer_cancel(request_id, CancelCode.REJECTED if asked and not agreed else code, agreed)

    def _find_canceled(self, request: Any) -> tuple[CancelCode, list[ServerGoal]]:
        info = request.goal_info
        code, goals = self._table.canceled_by(
            bytes(info.goal_id.uuid), info.stamp.sec * _NS + info.stamp.nanosec
        )
        return code, [self._goals[goal.id] for goal in goals]

    def _answer_cancel(self, request_id: RequestId, code: CancelCode, goals: list[ServerGoal]) -> None:
        response = self._support.cancel_goal.Response(return_code=int(code))
        canceled = [goal for goal in goals if goal.status in (GoalStatus.ACCEPTED, GoalStatus.EXECUTING)]
        response.goals_canceling = [self._support.info_of(goal._record) for goal in canceled]
        if self._ends is not None:
            core_of(self._ends.cancel).answer(request_id, response)
        for goal in canceled:
            self._advance(goal, GoalEvent.CANCEL_GOAL)
            if not self._executions.cancel(goal):
                goal.canceled()
                self._settle(goal)

    # --- results

    def _take_result(self, request: Any, request_id: RequestId) -> None:
        if self._is_early(self._take_result, request, request_id):
            return
        goal = self._goals.get(bytes(request.goal_id.uuid))
        if goal is None:
            self._send_result(request_id, self._support.get_result.Response())
        elif goal._response is not None:
            self._send_result(request_id, goal._response)
        elif len(goal._waiting) >= _MOST_WAITING and self._ends is not None:
            text = f"{_MOST_WAITING} requests wait for the result of goal {goal.id.hex()} already"
            core_of(self._ends.result).answer(request_id, None, text)
        else:
            goal._waiting.append(request_id)

    def _send_result(self, request_id: RequestId, response: Any) -> None:
        if self._ends is not None:
            self._ends.answer_result(request_id, response)

    def _expire(self) -> None:
        for goal in self._table.expire(monotonic_ns()):
            self._goals.pop(goal.id, None)
        due_ns = self._table.next_expiry_ns()
        if self._expiry is not None:
            self._expiry.cancel()
        if due_ns is not None and not self._is_stopped:
            loop = asyncio.get_running_loop()
            self._expiry = loop.call_later(max(due_ns - monotonic_ns(), 0) / _NS, self._expire)

    # --- for goals

    def _advance(self, goal: ServerGoal, event: GoalEvent) -> None:
        self._table.advance(goal._record, event, monotonic_ns())
        if goal.status.is_end:
            self._counts[goal.status.name.lower()] += 1
        self._publish_status()

    def _check_result(self, result: Any) -> None:
        if not isinstance(result, self._support.result):
            raise MessageTypeError(
                f"the result of action '{self.name}' must be a {self._support.result.__name__}, "
                f"not {type(result).__name__}"
            )
        if (error := type_support(self._support.result).explain(result)) is not None:
            raise error

    def _publish_feedback(self, goal: ServerGoal, feedback: Any) -> None:
        if not isinstance(feedback, self._support.feedback):
            raise MessageTypeError(
                f"what execute of action '{self.name}' yields must be a {self._support.feedback.__name__} or "
                f"a {self._support.result.__name__}, not {type(feedback).__name__}"
            )
        if self._ends is None or not goal.is_active:
            return
        message = self._support.feedback_message(goal_id=self._support.goal_id(goal.id), feedback=feedback)
        self._ends.feedback.publish(message)
        self._counts["feedback"] += 1

    def _publish_status(self) -> None:
        """Publish after this turn of the event loop, because an accepted goal is mostly executed at once."""
        if not self._is_status_due:
            self._is_status_due = True
            asyncio.get_running_loop().call_soon(self._publish_status_now)

    def _publish_status_now(self) -> None:
        self._is_status_due = False
        if self._ends is not None:
            with suppress(ConnectionClosed):  # the node has gone, and all readers were told
                self._ends.status.publish_encoded(self._support.encoded_status(self._table.shown()))


def _end_of(goal: ServerGoal) -> GoalEvent:
    """The end of a goal whose `execute` gives a Result and has not ended the goal itself."""
    if goal.is_cancel_requested:
        return GoalEvent.CANCELED
    return GoalEvent.ABORT if goal._is_given_up else GoalEvent.SUCCEED


def _is_async(callback: Callable[..., Any] | None) -> bool:
    return callback is not None and is_async(callback)
