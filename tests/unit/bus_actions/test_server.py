"""bus_actions.server: goals from request to result, on a bus of lists."""

import asyncio
from collections.abc import AsyncGenerator
from typing import Any

import pytest

from action_world import ActionWorld
from bus.errors import (
    ConfigurationError,
    ConnectionClosed,
    LocalProtocolError,
    MessageTypeError,
    ServiceError,
)
from bus.msg import Message, int32
from bus.service.server import RequestId
from bus_actions import (
    Action,
    ActionClient,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    GoalStatus,
    ServerGoal,
)
from bus_actions import server as server_module
from bus_actions.action_type import action_support
from jumping_loop import play


class Count(Action):
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
    try:
        await asyncio.sleep(1000)
    except asyncio.CancelledError:
        yield Count.Result(reached=-1)


async def forever(goal: ServerGoal) -> None:
    await asyncio.get_running_loop().create_future()


async def send(client: ActionClient, target: int = 0) -> Any:
    return await client.send_goal(Count.Goal(target=target))


async def turns(number: int = 10) -> None:
    for _ in range(number):
        await asyncio.sleep(0)


async def test_a_goal_succeeds_and_its_status_is_published_once_in_a_turn() -> None:
    world = ActionWorld()
    async with world.server(Count, count) as server, world.client(Count) as client:
        goal = await send(client, 3)
        assert [feedback.current async for feedback in goal] == [0, 1, 2]
        assert (await goal.result()).reached == 3
        await asyncio.sleep(0)
        assert world.statuses() == [[GoalStatus.EXECUTING], [GoalStatus.SUCCEEDED]]
        counts = server.statistics()
    assert (counts.accepted, counts.succeeded, counts.feedback, counts.active) == (1, 1, 3, 0)


@pytest.mark.parametrize("kind", ["send_goal", "get_result", "cancel_goal"])
async def test_an_answer_without_room_follows_later(kind: str) -> None:
    """The services of an action may be keep all."""
    world = ActionWorld()

    async def use(client: ActionClient) -> None:
        goal = await send(client, 3)
        await (goal.cancel() if kind == "cancel_goal" else goal.result())

    async with world.server(Count, wait if kind == "cancel_goal" else count), world.client(Count) as client:
        service = world.service(kind)
        service.has_room.clear()
        using = asyncio.ensure_future(use(client))
        await turns()
        assert not using.done() and not service.answers
        service.has_room.set()
        await using
        assert len(service.answers) == 1


async def test_no_answer_waits_for_room_after_the_close() -> None:
    world = ActionWorld()
    async with world.server(Count, count), world.client(Count) as client:
        world.service("send_goal").has_room.clear()
        sending = asyncio.ensure_future(send(client))
        await turns()
    await turns()
    with pytest.raises(ConnectionClosed):
        await sending


async def test_a_server_that_is_opened_again() -> None:
    world = ActionWorld()
    server = world.server(Count, count, result_timeout=float("inf"))
    async with world.client(Count) as client:
        for _ in range(2):
            async with server:
                assert (await (await send(client, 2)).result()).reached == 2


async def test_an_open_end_is_not_opened_again() -> None:
    world = ActionWorld()
    async with world.server(Count, count) as server, world.client(Count) as client:
        for end in (server, client):
            with pytest.raises(LocalProtocolError, match="is open already"):
                await end.open()
        assert (await (await send(client, 2)).result()).reached == 2


async def test_an_opening_that_is_cancelled_during_an_early_goal() -> None:
    world = ActionWorld()

    async def decide(goal: Any) -> bool:
        await asyncio.sleep(1000)
        return True

    async def ask(service: Any) -> None:
        if service.service_name.endswith("send_goal"):
            request = action_support(Count).send_goal.Request()
            await service.on_request(request, RequestId(b"c", 1))

    world.in_opening = ask
    server = world.server(Count, count, goal_callback=decide)
    opening = asyncio.ensure_future(server.open())
    await turns()
    assert world.services
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert not world.services and not world.publishers


@pytest.mark.parametrize("is_cancel", [False, True])
async def test_a_callback_that_awaited_a_cancelled_task(is_cancel: bool) -> None:
    """The client gets the error, and the server takes further requests."""
    world = ActionWorld()
    cancelled = asyncio.ensure_future(asyncio.sleep(1000))
    cancelled.cancel()

    async def wait_for_cancelled(_: Any) -> bool:
        await cancelled
        return True

    callback = {"cancel_callback" if is_cancel else "goal_callback": wait_for_cancelled}
    async with world.server(Count, wait, **callback), world.client(Count) as client:
        for _ in range(2):
            with pytest.raises(ServiceError, match="awaited a cancelled task"):
                await (await send(client)).cancel()
    assert [type(error) for error in world.server_node.errors] == [RuntimeError] * 2


def test_values_that_are_none() -> None:
    world = ActionWorld()
    for timeout in (-1.0, float("nan")):
        with pytest.raises(ConfigurationError, match="result_timeout must be at least 0 s"):
            world.server(Count, count, result_timeout=timeout)


async def test_what_becomes_of_a_goal_whose_execution_gives_no_result_or_raises() -> None:
    world = ActionWorld()

    async def nothing(goal: ServerGoal) -> None:
        if goal.request.target:
            raise ValueError("no")

    async with world.server(Count, nothing) as server, world.client(Count) as client:
        for target in (0, 1):
            with pytest.raises(GoalAborted):
                await (await send(client, target)).result()
        assert server.statistics().aborted == 2
    assert [str(error) for error in world.server_node.errors] == ["no"]


@pytest.mark.parametrize("given", [None, Count.Result(reached=7)])
async def test_a_goal_aborted_from_outside_stays_aborted_while_execute_runs_on(given: Any) -> None:
    world = ActionWorld()
    goes_on = asyncio.Event()

    async def execute(goal: ServerGoal) -> AsyncGenerator[Any, None]:
        await goes_on.wait()
        yield Count.Feedback(current=1)
        goal.publish_feedback(Count.Feedback(current=2))
        yield Count.Result(reached=3)

    async with world.server(Count, execute) as server, world.client(Count) as client:
        goal = await send(client)
        await turns()
        server.goals[0].abort(given)
        await turns()
        assert goal.status is GoalStatus.ABORTED and not goal.is_done
        goes_on.set()
        with pytest.raises(GoalAborted) as caught:
            await goal.result()
        assert caught.value.result.reached == (7 if given else 3)
        assert [feedback async for feedback in goal] == []
        assert server.statistics().feedback == 0
    assert world.server_node.errors == []


async def test_a_canceled_goal_ends_as_canceled_with_what_was_done_until_then() -> None:
    world = ActionWorld()
    async with world.server(Count, wait) as server, world.client(Count) as client:
        goal = await send(client)
        await asyncio.sleep(0)
        assert await goal.cancel()
        with pytest.raises(GoalCanceled) as caught:
            await goal.result()
        assert caught.value.result.reached == -1
        assert server.statistics().canceled == 1
        assert not await goal.cancel()


async def test_a_goal_that_is_canceled_in_the_turn_in_which_it_comes_ends() -> None:
    """The server cancels the task before its first step."""
    world = ActionWorld()
    async with world.server(Count, forever) as server, world.client(Count) as client:
        world.is_held = True
        sending = asyncio.ensure_future(send(client))
        await asyncio.sleep(0)
        client._request_cancel(bytes(16))  # of all goals
        world.release()
        goal = await sending
        await turns()
        assert (server.statistics().canceled, server.goals) == (1, [])
        assert goal.is_done
        with pytest.raises(GoalCanceled):
            await goal.result()


async def test_a_goal_that_waits_for_its_turn_is_canceled_without_being_executed() -> None:
    world = ActionWorld()
    begun: list[int] = []

    async def execute(goal: ServerGoal) -> None:
        begun.append(goal.request.target)
        await forever(goal)

    async with world.server(Count, execute, at_once=1) as server, world.client(Count) as client:
        goals = [await send(client, target) for target in range(3)]
        assert [goal.status for goal in server.goals] == [2, 1, 1]
        assert await goals[1].cancel()
        with pytest.raises(GoalCanceled):
            await goals[1].result()
        assert await goals[0].cancel()
        with pytest.raises(GoalCanceled):
            await goals[0].result()
        await asyncio.sleep(0)
        assert begun == [0, 2]


@pytest.mark.parametrize("is_async", [False, True])
async def test_callbacks_decide_which_goals_come_and_which_may_be_canceled(is_async: bool) -> None:
    world = ActionWorld()

    def is_wanted(request: Any) -> bool:
        if request.target > 10:
            raise ValueError("too far")
        return bool(request.target)

    def may_be_canceled(goal: ServerGoal) -> bool:
        return bool(goal.request.target == 1)

    async def is_wanted_later(request: Any) -> bool:
        return is_wanted(request)

    async def may_be_canceled_later(goal: ServerGoal) -> bool:
        return may_be_canceled(goal)

    server = world.server(
        Count,
        forever,
        goal_callback=is_wanted_later if is_async else is_wanted,
        cancel_callback=may_be_canceled_later if is_async else may_be_canceled,
    )
    async with server, world.client(Count) as client:
        with pytest.raises(GoalRejected):
            await send(client, 0)
        one, two = await send(client, 1), await send(client, 2)
        assert (await one.cancel(), await two.cancel()) == (True, False)
        cancels = [response.return_code for _, response in world.service("cancel_goal").answers]
        assert cancels == [0, 1]
        assert server.statistics().rejected == 1


async def test_a_callback_that_raises_is_told_to_the_client() -> None:
    world = ActionWorld()

    async def refuse(request: Any) -> bool:
        raise ValueError("no")

    async with world.server(Count, count, goal_callback=refuse), world.client(Count) as client:
        with pytest.raises(ServiceError, match="ValueError: no"):
            await send(client)
        assert [str(error) for error in world.server_node.errors] == ["no"]


async def test_a_goal_that_comes_twice_is_rejected() -> None:
    world = ActionWorld()
    asked: list[Any] = []
    async with (
        world.server(Count, forever, goal_callback=lambda request: asked.append(request) or True),
        world.client(Count) as client,
        world.client(Count) as other,
    ):
        goal_id = bytes(range(16))
        await client.send_goal(Count.Goal(), goal_id=goal_id)
        with pytest.raises(GoalRejected):
            await other.send_goal(Count.Goal(), goal_id=goal_id)
        assert len(asked) == 1


async def test_requests_that_come_while_it_opens_are_answered_when_it_is_open() -> None:
    world = ActionWorld()
    client = world.client(Count)
    goals: list[asyncio.Future[Any]] = []

    async def ask(service: Any) -> None:
        if service.service_name.endswith("send_goal"):
            await client.open()
            goals.append(asyncio.ensure_future(send(client, 2)))
            await turns()
            assert not goals[0].done()

    world.in_opening = ask
    async with world.server(Count, count):
        await turns()
        assert goals[0].done()
        assert (await goals[0].result().result()).reached == 2


async def test_a_request_that_comes_after_the_end_is_not_kept() -> None:
    world = ActionWorld()
    async with world.server(Count, count) as server:
        service = world.service("get_result")
    request = action_support(Count).get_result.Request()
    service.on_request(request, RequestId(bytes(16), 1))
    assert server._early == []


async def test_closing_aborts_what_is_executed_and_what_waits() -> None:
    world = ActionWorld()
    server = world.server(Count, wait, at_once=1)
    async with world.client(Count) as client:
        await server.open()
        goals = [await send(client) for _ in range(2)]
        await asyncio.sleep(0)
        await server.close()
        assert server.statistics().aborted == 2
        world.release()
        results = []
        for goal in goals:
            with pytest.raises(GoalAborted) as caught:
                await goal.result()
            results.append(caught.value.result.reached)
        assert results == [-1, 0]
        await server.close()


async def test_a_result_of_another_class_is_no_result() -> None:
    world = ActionWorld()

    async def execute(goal: ServerGoal) -> Any:
        return Count.Goal()

    async with world.server(Count, execute), world.client(Count) as client:
        with pytest.raises(GoalAborted):
            await (await send(client)).result()
    (error,) = world.server_node.errors
    assert isinstance(error, MessageTypeError)
    assert "the result of action '/act' must be a Count_Result, not Count_Goal" in str(error)


def test_results_are_kept_for_their_time() -> None:
    async def tell() -> None:
        world = ActionWorld()
        async with world.server(Count, count, result_timeout=10.0) as server, world.client(Count) as client:
            goal = await send(client)
            await goal.result()
            await asyncio.sleep(9.5)
            assert result_of(world, goal.id).status == GoalStatus.SUCCEEDED
            await asyncio.sleep(1.0)
            assert result_of(world, goal.id).status == GoalStatus.UNKNOWN
            assert server._goals == {}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(server_module, "monotonic_ns", lambda: round(asyncio.get_running_loop().time() * 1e9))
        play(tell)


async def test_a_closed_server_leaves_no_timer() -> None:
    world = ActionWorld()
    async with world.server(Count, count, result_timeout=1000.0) as server, world.client(Count) as client:
        await (await send(client)).result()
        expiry = server._expiry
        assert expiry is not None and not expiry.cancelled()
    assert expiry.cancelled()


async def test_so_many_requests_may_wait_for_one_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "_MOST_WAITING", 2)
    world = ActionWorld()
    async with world.server(Count, forever), world.client(Count) as client:
        goal = await send(client)
        await asyncio.sleep(0)
        assert world.service("get_result").answers == []  # the client's own request waits
        ask_for_result(world, goal.id)
        assert world.service("get_result").answers == []
        error = result_of(world, goal.id)
        assert f"2 requests wait for the result of goal {goal.id.hex()} already" in str(error)


def test_what_can_not_be_made() -> None:
    with pytest.raises(ConfigurationError, match="at_once must be at least 1, not 0"):
        ActionWorld().server(Count, count, at_once=0)
    with pytest.raises(MessageTypeError):
        ActionWorld().server(int, count)


def ask_for_result(world: ActionWorld, goal_id: bytes) -> None:
    support = action_support(Count)
    request = support.get_result.Request(goal_id=support.goal_id(goal_id))
    world.service("get_result").on_request(request, RequestId(b"another client..", 1))


def result_of(world: ActionWorld, goal_id: bytes) -> Any:
    ask_for_result(world, goal_id)
    return world.service("get_result").answers[-1][1]
