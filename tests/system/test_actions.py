"""Actions of `bus_actions` on the test's daemon, by both routes and on both event loops."""

import asyncio
import signal
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

import bus
from bus.msg import Message, int32
from bus_actions import (
    Action,
    ActionClient,
    ActionServer,
    ActionUnavailable,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    GoalStatus,
    InvalidTransition,
    ServerGoal,
    find_action,
)
from bus_actions.action_type import action_support
from bus_ros.rosidl import action_class
from cli import script
from conftest import WAIT_S, Daemon
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

Fibonacci = find_action("example_interfaces/action/Fibonacci")


class Count(Action):
    """An action type as users define it."""

    class Goal(Message, kw_only=True):
        target: int32 = 0

    class Result(Message, kw_only=True):
        reached: int32 = 0

    class Feedback(Message, kw_only=True):
        current: int32 = 0


async def count(goal: ServerGoal) -> AsyncGenerator[Any, None]:
    for current in range(goal.request.target):
        yield Count.Feedback(current=current)
    yield Count.Result(reached=goal.request.target)


async def wait(goal: ServerGoal) -> AsyncGenerator[Any, None]:
    """Runs until the goal is canceled."""
    reached = 0
    try:
        while True:
            reached += 1
            yield Count.Feedback(current=reached)
            await asyncio.sleep(0.001)
    except asyncio.CancelledError:
        yield Count.Result(reached=reached)


@pytest.fixture
async def other(daemon: Daemon) -> AsyncIterator[bus.Node]:
    """A second node, for the clients."""
    async with bus.Node("caller", arguments=[]) as other:
        yield other


@asynccontextmanager
async def serving(
    node: bus.Node, other: bus.Node, execute: Any, **more: Any
) -> AsyncIterator[tuple[ActionServer, ActionClient]]:
    async with (
        ActionServer(node, Count, "count", execute, **more) as server,
        ActionClient(other, Count, "count") as client,
    ):
        await client.wait_for_server()
        yield server, client


class TestGoals:
    async def test_feedback_and_result(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, count) as (server, client):
            assert (server.name, client.name) == ("/count", "/count")
            goal = await client.send_goal(Count.Goal(target=50))
            assert [feedback.current async for feedback in goal] == list(range(50))
            assert await goal.result() == await goal.result() == Count.Result(reached=50)
            assert goal.status is GoalStatus.SUCCEEDED
            assert not await goal.cancel()
            totals = server.statistics()
            assert (totals.accepted, totals.succeeded, totals.active, totals.feedback) == (1, 1, 0, 50)
            ours = client.statistics()
            assert (ours.sent, ours.accepted, ours.ended, ours.active) == (1, 1, 1, 0)

    async def test_several_goals_side_by_side(self, node: bus.Node, other: bus.Node) -> None:
        """Their feedback has room in the queues of 100 messages: of more, a busy machine would drop some."""
        async with serving(node, other, count) as (_, client), ActionClient(other, Count, "count") as second:
            await second.wait_for_server()
            goals = await asyncio.gather(
                *(one.send_goal(Count.Goal(target=target)) for target in range(8) for one in (client, second))
            )
            results = await asyncio.gather(*(goal.result() for goal in goals))
            assert [one.reached for one in results] == [target for target in range(8) for _ in range(2)]
            for goal in goals[-2:]:
                assert [one.current async for one in goal] == list(range(7))

    async def test_a_coroutine_in_place_of_a_generator(self, node: bus.Node, other: bus.Node) -> None:
        async def execute(goal: ServerGoal) -> Any:
            goal.publish_feedback(Count.Feedback(current=1))
            return Count.Result(reached=2)

        async with serving(node, other, execute) as (_, client):
            goal = await client.send_goal(Count.Goal())
            assert [one.current async for one in goal] == [1]
            assert (await goal.result()).reached == 2

    async def test_a_queue_of_one_at_a_time(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait, at_once=1) as (server, client):
            first = await client.send_goal(Count.Goal(target=1))
            second = await client.send_goal(Count.Goal(target=2))
            assert [goal.status for goal in server.goals] == [GoalStatus.EXECUTING, GoalStatus.ACCEPTED]
            assert await second.cancel()  # before it has started
            with pytest.raises(GoalCanceled) as end:
                await second.result()
            assert end.value.result == Count.Result()
            third = await client.send_goal(Count.Goal(target=3))
            assert await first.cancel()
            with pytest.raises(GoalCanceled):
                await first.result()
            assert (await anext(third)).current == 1

    async def test_the_other_kind_of_class(self, node: bus.Node, other: bus.Node) -> None:
        theirs: Any = action_class("example_interfaces/action/Fibonacci")

        async def execute(goal: ServerGoal) -> Any:
            goal.publish_feedback(theirs.Feedback(sequence=[goal.request.order]))
            return theirs.Result(sequence=[1, 2])

        async with (
            ActionServer(node, theirs, "fibonacci", execute),
            ActionClient(other, Fibonacci, "fibonacci") as client,
        ):
            await client.wait_for_server()
            goal = await client.send_goal(Fibonacci.Goal(order=7))
            assert [one.sequence async for one in goal] == [[7]]
            assert (await goal.result()).sequence == [1, 2]
            assert action_support(theirs).name == action_support(Fibonacci).name


class TestCancelling:
    async def test_it_is_a_cancelled_error(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait) as (server, client):
            goal = await client.send_goal(Count.Goal())
            async for feedback in goal:
                if feedback.current == 3:
                    assert await goal.cancel()
                    break
            with pytest.raises(GoalCanceled) as end:
                await goal.result()
            assert end.value.result.reached >= 3
            assert goal.status is GoalStatus.CANCELED
            assert server.statistics().canceled == 1

    async def test_nobody_catches_it(self, node: bus.Node, other: bus.Node) -> None:
        async def execute(goal: ServerGoal) -> Any:
            await asyncio.sleep(WAIT_S)

        async with serving(node, other, execute) as (_, client):
            goal = await client.send_goal(Count.Goal())
            assert await goal.cancel()
            with pytest.raises(GoalCanceled) as end:
                await goal.result()
            assert end.value.result == Count.Result()

    @pytest.mark.parametrize("is_awaited", [False, True])
    async def test_it_is_refused(self, node: bus.Node, other: bus.Node, is_awaited: bool) -> None:
        async def later(goal: ServerGoal) -> bool:
            return False

        callback: Any = later if is_awaited else lambda goal: False
        async with serving(node, other, wait, cancel_callback=callback) as (server, client):
            goal = await client.send_goal(Count.Goal())
            assert not await goal.cancel()
            assert server.goals[0].status is GoalStatus.EXECUTING

    async def test_of_send_goal_cancels_the_goal(self, node: bus.Node, other: bus.Node) -> None:
        is_asked = asyncio.Event()
        may_go_on = asyncio.Event()

        async def accept(goal: Any) -> bool:
            is_asked.set()
            await may_go_on.wait()
            return True

        async with serving(node, other, wait, goal_callback=accept) as (server, client):
            sending = asyncio.create_task(client.send_goal(Count.Goal()))
            await is_asked.wait()
            sending.cancel()
            with pytest.raises(asyncio.CancelledError):
                await sending
            may_go_on.set()
            await until(lambda: server.statistics().canceled == 1)

    async def test_of_result_leaves_the_goal(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait) as (server, client):
            goal = await client.send_goal(Count.Goal())
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.01):
                    await goal.result()
            assert server.goals[0].is_active
            assert await goal.cancel()
            with pytest.raises(GoalCanceled):
                await goal.result()


class TestBadEnds:
    async def test_requests_that_come_before_the_server_is_open(self, node: bus.Node) -> None:
        server = ActionServer(node, Count, "count", count)
        support = action_support(Count)
        request = support.send_goal.Request(goal_id=support.goal_id(bytes(range(16))), goal=Count.Goal())
        server._take_goal(request, bus.RequestId(bytes(16), 1))
        await server.open()
        await until(lambda: server.statistics().succeeded == 1)
        await server.close()

    async def test_a_goal_that_closes_its_server(self, node: bus.Node, other: bus.Node) -> None:
        async def execute(goal: ServerGoal) -> Any:
            await server.close()
            return Count.Result(reached=1)

        async with serving(node, other, execute) as (server, client):
            goal = await client.send_goal(Count.Goal())
            with pytest.raises((GoalAborted, ActionUnavailable)):
                await goal.result()

    async def test_states_that_are_none(self, node: bus.Node, other: bus.Node) -> None:
        """A status array with unknown status numbers breaks neither the client nor the server."""
        support = action_support(Count)
        publisher = await node.create_publisher(
            support.status_array, "count/_action/status", bus.qos.action_status_default
        )
        async with serving(node, other, wait) as (_, client):
            goal = await client.send_goal(Count.Goal())
            info = support.goal_info(goal_id=support.goal_id(goal.id))
            odd = [support.status(goal_info=info, status=number) for number in (77, -1)]
            publisher.publish(support.status_array(status_list=odd))
            assert await goal.cancel()
            with pytest.raises(GoalCanceled):
                await goal.result()

    async def test_nobody_serves(self, node: bus.Node) -> None:
        async with ActionClient(node, Count, "count") as client:
            assert not client.server_is_ready()
            with pytest.raises(ActionUnavailable, match="'/count' is not available: no server exists now"):
                await client.send_goal(Count.Goal())

    @pytest.mark.parametrize("is_awaited", [False, True])
    async def test_rejected(self, node: bus.Node, other: bus.Node, is_awaited: bool) -> None:
        async def later(goal: Any) -> bool:
            return bool(goal.target < 3)

        callback: Any = later if is_awaited else lambda goal: goal.target < 3
        async with serving(node, other, count, goal_callback=callback) as (server, client):
            with pytest.raises(GoalRejected, match="action '/count' rejected the goal"):
                await client.send_goal(Count.Goal(target=3))
            assert (await (await client.send_goal(Count.Goal(target=2))).result()).reached == 2
            assert server.statistics().rejected == 1

    async def test_a_goal_id_twice(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait) as (_, client), ActionClient(node, Count, "count") as second:
            await second.wait_for_server()
            goal = await client.send_goal(Count.Goal(), goal_id=bytes(range(16)))
            with pytest.raises(bus.LocalProtocolError, match=f"goal {goal.id.hex()} was sent already"):
                await client.send_goal(Count.Goal(), goal_id=goal.id)
            with pytest.raises(GoalRejected):
                await second.send_goal(Count.Goal(), goal_id=goal.id)
            with pytest.raises(bus.ConfigurationError, match="a goal's id has 16 bytes, not 3"):
                await client.send_goal(Count.Goal(), goal_id=b"abc")

    async def test_aborted(self, node: bus.Node, other: bus.Node) -> None:
        async def execute(goal: ServerGoal) -> AsyncGenerator[Any, None]:
            goal.abort(Count.Result(reached=1))
            goal.publish_feedback(Count.Feedback())  # dropped
            with pytest.raises(InvalidTransition, match="from state ABORTED with event SUCCEED"):
                goal.succeed()
            return
            yield

        async with serving(node, other, execute) as (_, client):
            goal = await client.send_goal(Count.Goal())
            with pytest.raises(GoalAborted, match="action '/count' aborted the goal") as end:
                await goal.result()
            assert end.value.result.reached == 1

    async def test_execute_ends_without_a_result(self, node: bus.Node, other: bus.Node) -> None:
        async def execute(goal: ServerGoal) -> None:
            pass

        async with serving(node, other, execute) as (_, client):
            with pytest.raises(GoalAborted):
                await (await client.send_goal(Count.Goal())).result()

    @pytest.mark.parametrize(
        ("outcome", "error"),
        [
            (ValueError("too far"), ValueError),
            (Count.Goal(), bus.MessageTypeError),
            (Count.Feedback(current="x"), bus.MessageTypeError),  # type: ignore[arg-type]
            (Count.Result(reached="x"), bus.MessageTypeError),  # type: ignore[arg-type]
        ],
    )
    async def test_execute_raises_or_yields_something_else(
        self, daemon: Daemon, other: bus.Node, outcome: Any, error: type[Exception]
    ) -> None:
        async def execute(goal: ServerGoal) -> AsyncGenerator[Any, None]:
            if isinstance(outcome, Exception):
                raise outcome
            yield outcome

        async def serve(is_open: asyncio.Event) -> None:
            async with bus.Node("server", arguments=[]) as node, ActionServer(node, Count, "count", execute):
                is_open.set()
                await node.spin()

        is_open = asyncio.Event()
        server = asyncio.create_task(serve(is_open))
        await is_open.wait()
        async with ActionClient(other, Count, "count") as client:
            await client.wait_for_server()
            goal = await client.send_goal(Count.Goal())
            with pytest.raises(GoalAborted):
                await goal.result()
        with pytest.raises(error):
            await server

    @pytest.mark.parametrize("which", ["goal_callback", "cancel_callback"])
    async def test_a_callback_raises(self, other: bus.Node, which: str) -> None:
        """The client and the server's node both get the error."""

        def refuse(asked: Any) -> bool:
            raise ValueError("too far")

        async def serve(is_open: asyncio.Event) -> None:
            options: dict[str, Any] = {which: refuse}
            async with (
                bus.Node("server", arguments=[]) as node,
                ActionServer(node, Count, "count", wait, **options),
            ):
                is_open.set()
                await node.spin()

        is_open = asyncio.Event()
        server = asyncio.create_task(serve(is_open))
        await is_open.wait()
        async with ActionClient(other, Count, "count") as client:
            await client.wait_for_server()
            with pytest.raises(bus.ServiceError, match="ValueError: too far"):
                await (await client.send_goal(Count.Goal())).cancel()
        with pytest.raises(ValueError, match="too far"):
            await server

    async def test_the_client_closes(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait) as (server, client):
            goal = await client.send_goal(Count.Goal())
            results = asyncio.create_task(goal.result())
            await asyncio.sleep(0)
            await client.close()
            with pytest.raises(bus.ConnectionClosed):
                await results
            assert server.goals[0].is_active

    async def test_busd_comes_back(self, daemon: Daemon, node: bus.Node, other: bus.Node) -> None:
        may_end = asyncio.Event()

        async def execute(goal: ServerGoal) -> Any:
            await may_end.wait()
            return Count.Result(reached=5)

        async with serving(node, other, execute) as (_, client):
            goal = await client.send_goal(Count.Goal())
            daemon.kill()
            daemon.restart()
            await client.wait_for_server()
            may_end.set()
            assert (await goal.result()).reached == 5
            assert (await (await client.send_goal(Count.Goal())).result()).reached == 5

    async def test_what_is_lost_with_busd(
        self, daemon: Daemon, node: bus.Node, other: bus.Node, route: str
    ) -> None:
        """On the socket route, busd dies before it reads a goal, a cancellation or a result."""

        may_end = asyncio.Event()

        async def execute(goal: ServerGoal) -> AsyncGenerator[Any, None]:
            yield Count.Feedback()
            await may_end.wait()
            yield Count.Result(reached=7)

        @asynccontextmanager
        async def losing(client: ActionClient) -> AsyncIterator[None]:
            daemon.process.send_signal(signal.SIGSTOP)
            yield
            daemon.kill()
            daemon.restart()
            await client.wait_for_server()

        async with serving(node, other, execute) as (server, client):
            async with losing(client):
                sending = asyncio.ensure_future(client.send_goal(Count.Goal()))
                await until(lambda: client.statistics().sent == 1)
            if route == "socket":
                with pytest.raises(
                    ActionUnavailable,
                    match="busd, or a connection to it, has ended meanwhile, and the goal or its",
                ):
                    await sending
                assert not server.goals
            else:
                assert await (await sending).cancel()
            goal = await client.send_goal(Count.Goal())
            await anext(goal)
            async with losing(client):
                canceling = asyncio.ensure_future(goal.cancel())
                await until(lambda: client._cancels or canceling.done())
            assert await canceling
            with pytest.raises(GoalCanceled):
                await goal.result()
            goal = await client.send_goal(Count.Goal())
            await anext(goal)
            async with losing(client):
                may_end.set()
                await until(lambda: not server._executions._running)
            assert (await goal.result()).reached == 7

    async def test_the_server_closes(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, wait, at_once=1) as (server, client):
            goals = [await client.send_goal(Count.Goal()) for _ in range(2)]
            await server.close()
            for goal in goals:
                with pytest.raises(GoalAborted):
                    await goal.result()

    async def test_the_node_of_the_server_closes(self, other: bus.Node) -> None:
        async with ActionClient(other, Count, "count") as client:
            ended = asyncio.Event()

            async def execute(goal: ServerGoal) -> None:
                try:
                    await asyncio.sleep(WAIT_S)
                finally:
                    ended.set()

            async with bus.Node("server", arguments=[]) as node:
                server = ActionServer(node, Count, "count", execute)
                await server.open()
                await client.wait_for_server()
                goal = await client.send_goal(Count.Goal())
            await ended.wait()
            with pytest.raises((GoalAborted, ActionUnavailable)):
                await goal.result()

    async def test_the_server_dies(self, other: bus.Node) -> None:
        async with ActionClient(other, Count, "count") as client:
            with script(DYING) as server:
                await client.wait_for_server()
                goal = await client.send_goal(Count.Goal())
                assert (await anext(goal)).current == 1
                server.process.kill()
            assert [feedback async for feedback in goal] == []
            with pytest.raises(ActionUnavailable, match="its server has left before the goal's end"):
                await goal.result()
            assert client.statistics().active == 0

    async def test_results_expire(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, count, result_timeout=0.0) as (_, client):
            goal = await client.send_goal(Count.Goal(target=1))
            with pytest.raises(ActionUnavailable, match="does not know the goal"):
                while True:
                    await goal.result()
                    client._request_result(goal)
                    goal._outcome = None

    async def test_more_feedback_than_anybody_reads(self, node: bus.Node, other: bus.Node) -> None:
        async with serving(node, other, count) as (_, client):
            goal = await client.send_goal(Count.Goal(target=1))
            await goal.result()
            for current in range(2000):
                goal._take_feedback(Count.Feedback(current=current))
            assert [one.current async for one in goal] == list(range(1000, 2000))

    async def test_what_is_no_action(self, node: bus.Node) -> None:
        with pytest.raises(bus.MessageTypeError, match="is no action"):
            ActionClient(node, Count.Goal, "count")
        with pytest.raises(bus.ConfigurationError, match="must not start with a number"):
            ActionServer(node, Count, "1count", count)
        with pytest.raises(bus.ConfigurationError, match="at_once must be at least 1, not 0"):
            ActionServer(node, Count, "count", count, at_once=0)
        with pytest.raises(bus.ConnectionClosed, match="action client 'count' is not open"):
            await ActionClient(node, Count, "count").send_goal(Count.Goal())


DYING = """
import asyncio, bus
from bus.msg import Message, int32
from bus_actions import Action, ActionServer

class Count(Action):
    class Goal(Message, kw_only=True):
        target: int32 = 0
    class Result(Message, kw_only=True):
        reached: int32 = 0
    class Feedback(Message, kw_only=True):
        current: int32 = 0

async def execute(goal):
    yield Count.Feedback(current=1)
    await asyncio.sleep(1000)

async def main():
    async with bus.Node("server", arguments=[]) as node, ActionServer(node, Count, "count", execute):
        print("ready", flush=True)
        await node.spin()

bus.run(main())
"""
