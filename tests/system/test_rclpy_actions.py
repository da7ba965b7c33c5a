"""rclpy.action, by both routes: servers, clients, handles, failures; and servers of the native API."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

import bus_ros.rclpy as rclpy
from bus.endpoint.endpoint import core_of
from bus.errors import ServiceError
from bus.shm import has_core
from bus_actions import ActionUnavailable, GoalStatus, goal_table
from bus_ros.engine import Engine
from bus_ros.rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from bus_ros.rclpy.action.graph import (
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from bus_ros.rclpy.action.server import ServerGoalHandle
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.exceptions import InvalidHandle, RCLError
from bus_ros.rclpy.executors import Executor, MultiThreadedExecutor
from bus_ros.rclpy.task import Future
from bus_ros.rosidl import action_class, message_class
from callcount import CallCounter
from cli import script
from conftest import WAIT_S, Daemon
from rclpy_world import World, arguments, every_kind, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")

Fibonacci: Any = action_class("example_interfaces/action/Fibonacci")
GoalInfo: Any = message_class("action_msgs/msg/GoalInfo")
UUID: Any = message_class("unique_identifier_msgs/msg/UUID")
TYPE = "example_interfaces/action/Fibonacci"


def execute(goal_handle: ServerGoalHandle) -> Any:
    """The requested number of integers, each also sent as feedback."""
    sequence: list[int] = []
    for number in range(goal_handle.request.order):
        sequence.append(number)
        goal_handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
    goal_handle.succeed()
    return Fibonacci.Result(sequence=sequence)


class Ends:
    """A server's node, a client's node, and the goals between them."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.server_node, self.node = world.node("server"), world.node("caller")
        self.client = ActionClient(self.node, Fibonacci, "fibonacci")
        self.feedback: list[list[int]] = []
        self._executor: Executor | None = None

    def serve(self, callback: Callable[[ServerGoalHandle], Any] = execute, **options: Any) -> ActionServer:
        server = ActionServer(self.server_node, Fibonacci, "fibonacci", callback, **options)
        assert self.client.wait_for_server(timeout_sec=WAIT_S)
        return server

    def send(self, order: int = 3, **options: Any) -> Any:
        """Sends a goal; its handle."""
        future = self.client.send_goal_async(Fibonacci.Goal(order=order), self.hear, **options)
        return self.done(future)

    def done(self, future: Future[Any]) -> Any:
        self.spin_until(future.done)
        return future.result()

    def spin_until(self, condition: Callable[[], object]) -> None:
        """Always with the same executor, which keeps the tasks of goals."""
        if self._executor is None:
            self._executor = self.world.executor(self.server_node, self.node)
        self.world.spin_executor_until(condition, self._executor)

    def result(self, goal_handle: Any) -> tuple[GoalStatus, list[int]]:
        response = self.done(goal_handle.get_result_async())
        return GoalStatus(response.status), list(response.result.sequence)

    def hear(self, message: Any) -> None:
        self.feedback.append(list(message.feedback.sequence))


@pytest.fixture
def ends(world: World) -> Ends:
    return Ends(world)


def test_feedback_and_result(ends: Ends) -> None:
    server = ends.serve()
    goal_handle = ends.send(3)
    assert goal_handle.accepted and goal_handle.stamp.sec > 0
    assert ends.result(goal_handle) == (GoalStatus.SUCCEEDED, [0, 1, 2])
    assert ends.feedback == [[0], [0, 1], [0, 1, 2]]
    ends.spin_until(lambda: goal_handle.status == GoalStatus.SUCCEEDED)
    assert ends.result(goal_handle)[0] is GoalStatus.SUCCEEDED  # once more
    assert server.action_type is Fibonacci
    assert ends.done(goal_handle.cancel_goal_async()).return_code == 3  # the goal has ended


def test_the_answer_to_a_goal_is_told_before_its_feedback(ends: Ends) -> None:
    """Even if both are queued when the client's node spins: feedback callbacks may use the goal's handle."""
    ended: list[ServerGoalHandle] = []

    def run(goal_handle: ServerGoalHandle) -> Any:
        ended.append(goal_handle)
        return execute(goal_handle)

    ends.serve(run)
    told: list[str] = []
    client, server = ends.world.executor(ends.node), ends.world.executor(ends.server_node)
    future = ends.client.send_goal_async(Fibonacci.Goal(order=1), lambda _: told.append("feedback"))
    future.add_done_callback(lambda _: told.append("accepted"))
    ends.world.spin_executor_until(lambda: ended and not ended[0].is_active and ends.client._calls, server)
    ends.world.spin_executor_until(lambda: len(told) == 2, client)
    assert told == ["accepted", "feedback"]


def test_feedback_that_overtakes_the_answer_waits_for_it(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    ends.serve(execute)
    held: list[tuple[Any, ...]] = []
    put = ends.client._put_answer
    monkeypatch.setattr(ends.client, "_put_answer", lambda *answer: held.append(answer))
    told: list[str] = []
    client, server = ends.world.executor(ends.node), ends.world.executor(ends.server_node)
    future = ends.client.send_goal_async(Fibonacci.Goal(order=1), lambda _: told.append("feedback"))
    future.add_done_callback(lambda _: told.append("accepted"))
    ends.world.spin_executor_until(lambda: held, server)
    ends.world.spin_executor_until(lambda: ends.client._early_feedback, client)
    assert told == []
    with ends.client._engine.loop:
        put(*held[0])
    ends.world.spin_executor_until(lambda: len(told) == 2, client)
    assert told == ["accepted", "feedback"] and not ends.client._early_feedback


def test_cancelled_futures_are_forgotten(ends: Ends) -> None:
    """Their answers are ignored; the goal goes on, and its feedback is told."""
    ends.serve()
    client = ends.client
    future = client.send_goal_async(Fibonacci.Goal(order=2), ends.hear)
    future.cancel()
    assert not client._pending_goal_requests and not client._unanswered
    ends.spin_until(lambda: len(ends.feedback) == 2)
    goal_handle = ends.send(0)
    later = [goal_handle.get_result_async(), goal_handle.cancel_goal_async()]
    for one in later:
        one.cancel()
    assert not client._pending_result_requests and not client._pending_cancel_requests
    assert [
        end.statistics().pending for end in (client._ends.goal, client._ends.cancel, client._ends.result)
    ] == [0, 0, 0]
    assert ends.result(goal_handle) == (GoalStatus.SUCCEEDED, [])
    assert all(one.cancelled() and one.result() is None for one in [future, *later])


@pytest.mark.parametrize("kind", ["goal", "result", "cancel"])
def test_an_answer_of_a_cancelled_future_may_wait_already(ends: Ends, kind: str) -> None:
    ends.serve()
    goal_handle = ends.send(0)
    future = {
        "goal": lambda: ends.client.send_goal_async(Fibonacci.Goal(order=0)),
        "result": goal_handle.get_result_async,
        "cancel": goal_handle.cancel_goal_async,
    }[kind]()
    server, client = ends.world.executor(ends.server_node), ends.world.executor(ends.node)
    ends.world.spin_executor_until(lambda: ends.client._calls, server)
    future.cancel()
    ends.world.spin_executor_until(lambda: not ends.client._calls, client)
    assert future.cancelled() and future.result() is None


def test_an_async_callback_and_a_cancellation(ends: Ends) -> None:
    is_asked = Future[bool]()
    handles: list[ServerGoalHandle] = []

    async def wait(goal_handle: ServerGoalHandle) -> Any:
        handles.append(goal_handle)
        await is_asked
        goal_handle.canceled()
        return Fibonacci.Result(sequence=[7])

    def cancel(goal_handle: ServerGoalHandle) -> CancelResponse:
        is_asked.set_result(True)
        return CancelResponse.ACCEPT

    ends.serve(wait, cancel_callback=cancel)
    goal_handle = ends.send()
    response = ends.done(goal_handle.cancel_goal_async())
    assert [one.goal_id for one in response.goals_canceling] == [goal_handle.goal_id]
    assert ends.result(goal_handle) == (GoalStatus.CANCELED, [7])
    assert (handles[0].status, handles[0].is_active, handles[0].is_cancel_requested) == (5, False, False)


def test_by_default_a_cancellation_is_rejected(ends: Ends) -> None:
    may_end = Future[bool]()

    async def wait(goal_handle: ServerGoalHandle) -> Any:
        await may_end
        return execute(goal_handle)

    ends.serve(wait)
    goal_handle = ends.send(1)
    response = ends.done(goal_handle.cancel_goal_async())
    assert (response.return_code, response.goals_canceling) == (0, [])
    may_end.set_result(True)
    assert ends.result(goal_handle) == (GoalStatus.SUCCEEDED, [0])


def test_deferred_goals_one_after_the_other(ends: Ends) -> None:
    """As in rclpy's examples: a queue of goals, in which the end of each starts the next."""
    queue: list[ServerGoalHandle] = []
    order: list[int] = []

    def accept(goal_handle: ServerGoalHandle) -> None:
        queue.append(goal_handle)
        if len(queue) == 1:
            goal_handle.execute()

    def run(goal_handle: ServerGoalHandle) -> Any:
        order.append(goal_handle.request.order)
        result = execute(goal_handle)
        queue.pop(0)
        if queue:
            queue[0].execute()
        return result

    ends.serve(run, handle_accepted_callback=accept)
    futures = [ends.client.send_goal_async(Fibonacci.Goal(order=number)) for number in (3, 1, 2)]
    handles = [ends.done(future) for future in futures]
    assert [ends.result(one)[1] for one in handles] == [[0, 1, 2], [0], [0, 1]]
    assert order == [3, 1, 2]


def test_a_goal_that_is_begun_while_nobody_spins(ends: Ends) -> None:
    """It holds no callback group, so that it can be canceled."""
    accepted: list[ServerGoalHandle] = []
    is_asked = Future[bool]()

    async def wait(goal_handle: ServerGoalHandle) -> Any:
        await is_asked
        goal_handle.canceled()
        return Fibonacci.Result()

    def cancel(goal_handle: ServerGoalHandle) -> CancelResponse:
        is_asked.set_result(True)
        return CancelResponse.ACCEPT

    ends.serve(wait, handle_accepted_callback=accepted.append, cancel_callback=cancel)
    executor = ends.world.executor(ends.server_node, ends.node)
    future = ends.client.send_goal_async(Fibonacci.Goal())
    ends.world.spin_executor_until(lambda: future.done() and accepted, executor)
    executor.shutdown()
    accepted[0].execute()
    goal_handle: Any = future.result()
    assert len(ends.done(goal_handle.cancel_goal_async()).goals_canceling) == 1
    assert ends.result(goal_handle)[0] is GoalStatus.CANCELED


@every_kind
def test_calls_that_wait(ends: Ends, kind: Any) -> None:
    ends.serve(callback_group=ReentrantCallbackGroup())
    with ends.world.spinning(ends.server_node, kind=kind):
        response = ends.client.send_goal(Fibonacci.Goal(order=2))
        assert list(response.result.sequence) == [0, 1]
        handle_of = ends.client.send_goal_async(Fibonacci.Goal(order=1))
        rclpy.spin_until_future_complete(ends.node, handle_of, timeout_sec=WAIT_S)
        goal_handle = handle_of.result()
        assert list(goal_handle.get_result().result.sequence) == [0]
        assert goal_handle.cancel_goal().return_code == 3


def test_goals_side_by_side_in_many_threads(ends: Ends) -> None:
    together = threading.Barrier(3)

    def meet(goal_handle: ServerGoalHandle) -> Any:
        together.wait(WAIT_S)
        return execute(goal_handle)

    ends.serve(meet)
    with ends.world.spinning(ends.server_node, ends.node, kind=lambda: MultiThreadedExecutor(4)):
        futures = [ends.client.send_goal_async(Fibonacci.Goal(order=number)) for number in range(3)]
        results: list[int] = []
        is_done = threading.Event()

        def take(future: Future[Any]) -> None:
            response: Any = future.result()
            results.append(len(response.result.sequence))
            if len(results) == 3:
                is_done.set()

        for future in futures:
            future.add_done_callback(
                lambda one: one.result().get_result_async().add_done_callback(take)  # type: ignore[union-attr]
            )
        assert is_done.wait(WAIT_S)
    assert sorted(results) == [0, 1, 2]


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (GoalResponse.REJECT, ""),
        (True, "Goal request callback did not return a GoalResponse type. Rejecting goal."),
    ],
)
def test_goals_that_are_rejected(
    ends: Ends, answer: Any, text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    server = ends.serve()
    server.register_goal_callback(lambda goal: answer)
    goal_handle = ends.send()
    assert not goal_handle.accepted and text in capfd.readouterr().err
    assert "accepted=False, status=0>" in repr(goal_handle)
    server.register_goal_callback(None)
    assert ends.send().accepted


def raising(goal_handle: ServerGoalHandle) -> Any:
    raise ValueError("boom")


@pytest.mark.parametrize(
    ("callback", "text"),
    [
        (raising, "Error raised in execute callback: boom"),
        (lambda goal_handle: Fibonacci.Result(), "Goal state not set, assuming aborted. Goal ID: "),
    ],
)
def test_execute_raises_or_forgets_the_state(
    ends: Ends, callback: Any, text: str, capfd: pytest.CaptureFixture[str]
) -> None:
    ends.serve(callback)
    assert ends.result(ends.send()) == (GoalStatus.ABORTED, [])
    assert text in capfd.readouterr().err


@pytest.mark.parametrize("which", ["goal_callback", "cancel_callback"])
def test_a_callback_raises(ends: Ends, which: str) -> None:
    """The client gets the error, and `spin` raises the exception."""

    def refuse(asked: Any) -> Any:
        raise ValueError("too far")

    async def wait(goal_handle: ServerGoalHandle) -> Any:
        await Future[None]()

    ends.serve(wait, **{which: refuse})
    future: Future[Any] = ends.client.send_goal_async(Fibonacci.Goal())
    if which == "cancel_callback":
        future = ends.done(future).cancel_goal_async()
    with pytest.raises(ValueError, match="too far"):
        ends.spin_until(lambda: False)
    with pytest.raises(ServiceError, match="ValueError: too far"):
        ends.done(future)


def test_a_result_that_is_none(ends: Ends) -> None:
    """The program gets an exception, and the client a result."""

    def forget(goal_handle: ServerGoalHandle) -> Any:
        goal_handle.succeed()

    ends.serve(forget)
    future = ends.client.send_goal_async(Fibonacci.Goal())
    with pytest.raises(AssertionError, match="The 'result' field must be a sub message"):
        ends.spin_until(lambda: False)
    assert ends.result(ends.done(future)) == (GoalStatus.SUCCEEDED, [])


def test_busd_comes_back(ends: Ends, daemon: Daemon) -> None:
    may_end = Future[bool]()

    async def wait(goal_handle: ServerGoalHandle) -> Any:
        await may_end
        return execute(goal_handle)

    ends.serve(wait)
    result = ends.send(1).get_result_async()
    daemon.kill()
    daemon.restart()
    ends.spin_until(ends.client.server_is_ready)
    may_end.set_result(True)
    assert ends.done(result).status == GoalStatus.SUCCEEDED


def test_what_a_handle_refuses(ends: Ends) -> None:
    errors: list[str] = []

    def run(goal_handle: ServerGoalHandle) -> Any:
        for call in (goal_handle.canceled, goal_handle.succeed, goal_handle.succeed, goal_handle.abort):
            try:
                call()
            except RCLError as error:
                errors.append(str(error).removeprefix("Failed to update goal state: goal_handle attempted "))
        for wrong in (5, Fibonacci.Result()):
            with pytest.raises(TypeError):
                goal_handle.publish_feedback(wrong)
        goal_handle.publish_feedback(Fibonacci.Feedback())  # allowed after the end, as in rclpy
        return Fibonacci.Result()

    ends.serve(run)
    assert ends.result(ends.send())[0] is GoalStatus.SUCCEEDED
    assert errors == [
        "invalid transition from state EXECUTING with event CANCELED",
        "invalid transition from state SUCCEEDED with event SUCCEED",
        "invalid transition from state SUCCEEDED with event ABORT",
    ]


def test_ids_that_are_known_and_that_are_not(ends: Ends) -> None:
    server = ends.serve()
    one = UUID(uuid=list(range(16)))
    first = ends.send(goal_uuid=one)
    assert first.accepted and first.goal_id == one
    assert not ends.send(goal_uuid=one).accepted
    first._goal_id = UUID(uuid=[9] * 16)
    assert ends.result(first) == (GoalStatus.UNKNOWN, [])
    assert ends.done(first.cancel_goal_async()).return_code == 2
    info = GoalInfo(goal_id=one)
    with pytest.raises(RCLError, match="Failed to accept new goal: goal ID already exists"):
        ServerGoalHandle(server, info, Fibonacci.Goal())


def test_results_expire(ends: Ends) -> None:
    server = ends.serve(result_timeout=0.01)
    goal_handle = ends.send()
    ends.spin_until(lambda: not server._goal_handles)
    assert ends.result(goal_handle) == (GoalStatus.UNKNOWN, [])


def test_a_result_that_expires_during_its_execution_comes_all_the_same(ends: Ends) -> None:
    is_asked = Future[None]()

    async def run(goal_handle: ServerGoalHandle) -> Any:
        await is_asked
        goal_handle.succeed()
        server._execute_expire_goals([bytes(goal_handle.goal_id.uuid)])  # another thread may do it now
        return Fibonacci.Result(sequence=[7])

    server = ends.serve(run)
    result = ends.send().get_result_async()
    ends.spin_until(lambda: all(one._waiters for one in server._result_futures.values()))
    is_asked.set_result(None)
    assert list(ends.done(result).result.sequence) == [7]


def test_answers_without_room_follow_later(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    """The services of an action may be keep all."""
    server = ends.serve()
    refused: list[str] = []

    async def wait() -> None: ...

    for name in ("goal", "result"):
        core = core_of(getattr(server._ends, name))

        def publish(answer: Any, name: str = name, publish: Any = core._publish) -> Any:
            if name in refused:
                return publish(answer)
            refused.append(name)
            return False

        monkeypatch.setattr(core, "_publish", publish)
        monkeypatch.setattr(core.replies, "wait_for_room", wait)
    assert ends.result(ends.send(2)) == (GoalStatus.SUCCEEDED, [0, 1])
    assert refused == ["goal", "result"]


def test_the_end_of_a_goal_wakes_no_other_thread(ends: Ends, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if it drops the oldest result. The spinning thread runs the event loop next; a change of threads
    would cost more than all the rest of a goal's end."""
    monkeypatch.setattr(goal_table, "MOST_ENDED", 2)
    nudges: list[int] = []
    monkeypatch.setattr(Engine, "nudge", lambda _: nudges.append(1))
    server = ends.serve()
    nudges.clear()
    for _ in range(6):
        assert ends.result(ends.send())[0] is GoalStatus.SUCCEEDED
    assert nudges == []
    ends.spin_until(lambda: len(server._goal_handles) == 2)


def test_arguments_that_are_wrong(ends: Ends) -> None:
    wrong: Any
    for wrong in (5, Fibonacci.Result()):
        with pytest.raises(TypeError):
            ends.client.send_goal_async(wrong)
        with pytest.raises(TypeError):
            ends.client.send_goal(wrong)
        with pytest.raises(TypeError, match="Expected type ClientGoalHandle but received"):
            ends.client._get_result_async(wrong)
    with pytest.raises(TypeError, match="Failed to register goal execution callback: not callable"):
        ActionServer(ends.node, Fibonacci, "x", None)  # type: ignore[arg-type]
    # tests/differential/programs/actions.py compares their texts with rclpy's.
    for name in ("", "1x"):
        with pytest.raises(ValueError, match="Failed to create action client"):
            ActionClient(ends.node, Fibonacci, name)
        with pytest.raises(ValueError, match="Failed to create action server"):
            ActionServer(ends.node, Fibonacci, name, execute)
    with pytest.raises(AttributeError, match="_TYPE_SUPPORT"):
        ActionClient(ends.node, int, "x")
    with pytest.raises(RuntimeError, match="this might be a message or service"):
        ActionClient(ends.node, UUID, "x")


def test_after_the_end(ends: Ends) -> None:
    server = ends.serve()
    goal_handle = ends.send()
    assert ends.result(goal_handle)[0] is GoalStatus.SUCCEEDED
    theirs = next(iter(server._goal_handles.values()))
    server.destroy()
    theirs.succeed()  # allowed without its server, as in rclpy
    assert (theirs.status, theirs.is_active) == (0, False)
    with pytest.raises(ValueError, match="not in list"):
        server.destroy()
    with pytest.raises(ActionUnavailable):
        ends.done(goal_handle.get_result_async())
    assert not ends.client.wait_for_server(timeout_sec=0.01)
    ends.client.destroy()
    with pytest.raises(InvalidHandle, match="destruction was requested"):
        ends.client.send_goal_async(Fibonacci.Goal())
    ends.node.destroy_node()
    with pytest.raises(InvalidHandle, match="destruction was requested"):
        ActionClient(ends.node, Fibonacci, "x")


def test_the_graph(ends: Ends) -> None:
    ends.serve()
    found = [("/fibonacci", [TYPE])]
    assert get_action_names_and_types(ends.node) == found
    assert get_action_server_names_and_types_by_node(ends.node, "server", "/") == found
    assert get_action_client_names_and_types_by_node(ends.node, "server", "/") == []
    assert get_action_client_names_and_types_by_node(ends.node, "caller", "/") == found
    assert ("/fibonacci/_action/send_goal", [f"{TYPE}_SendGoal"]) in ends.node.get_service_names_and_types()


NATIVE = """
import asyncio, bus
from bus_actions import ActionServer, find_action
Fibonacci = find_action("example_interfaces/action/Fibonacci")

async def execute(goal):
    yield Fibonacci.Feedback(sequence=[goal.request.order])
    if goal.request.order == 99:
        await asyncio.sleep(1000)
    yield Fibonacci.Result(sequence=[1, 2])

async def main():
    async with bus.Node("server", arguments=[]) as node, ActionServer(node, Fibonacci, "fibonacci", execute):
        print("ready", flush=True)
        await node.spin()

bus.run(main())
"""


def test_a_server_of_the_bus_that_dies(ends: Ends) -> None:
    with script(NATIVE) as server:
        assert ends.client.wait_for_server(timeout_sec=WAIT_S)
        assert ends.result(ends.send(5)) == (GoalStatus.SUCCEEDED, [1, 2])
        assert ends.feedback == [[5]]
        goal_handle = ends.send(99)
        future = goal_handle.get_result_async()
        ends.spin_until(lambda: [99] in ends.feedback)
        server.process.kill()
    with pytest.raises(ActionUnavailable, match="its server has left before it answered"):
        ends.done(future)
    with pytest.raises(ActionUnavailable):
        ends.done(goal_handle.get_result_async())


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
def test_calls_of_an_action(ends: Ends, route: str) -> None:
    """Both ends' calls for a goal, ten feedbacks and a result; each status lists the 20 ended goals."""
    if route != "shm":
        pytest.skip("by the socket it depends on what comes together")
    ends.serve()
    counted: list[int] = []
    for _ in range(30):
        with CallCounter() as counter:
            ends.done(ends.send(10).get_result_async())
        counted.append(counter.python)
    assert 400 <= min(counted[20:]) <= 720
