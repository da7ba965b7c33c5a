"""bus_actions.client: a client's knowledge of its goals, on a bus of lists."""

import asyncio
from typing import Any

import pytest

from action_world import NAME, ActionWorld
from bus.errors import ConfigurationError, ConnectionClosed, LocalProtocolError
from bus.msg import Message, int32
from bus_actions import (
    Action,
    ActionClient,
    ActionUnavailable,
    GoalAborted,
    GoalCanceled,
    GoalStatus,
    ServerGoal,
)
from bus_actions import client as client_module


class Walk(Action):
    class Goal(Message, kw_only=True):
        steps: int32 = 0

    class Result(Message, kw_only=True):
        done: int32 = 0

    class Feedback(Message, kw_only=True):
        step: int32 = 0


async def walk(goal: ServerGoal) -> Any:
    for step in range(goal.request.steps):
        goal.publish_feedback(Walk.Feedback(step=step))
    return Walk.Result(done=goal.request.steps)


async def forever(goal: ServerGoal) -> None:
    await asyncio.get_running_loop().create_future()


async def send(client: ActionClient, steps: int = 0, **kwargs: Any) -> Any:
    return await client.send_goal(Walk.Goal(steps=steps), **kwargs)


async def turns(number: int = 10) -> None:
    for _ in range(number):
        await asyncio.sleep(0)


async def test_the_newest_feedback_is_kept_for_who_reads_it_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_module, "_MOST_FEEDBACK", 3)
    world = ActionWorld()
    async with world.server(Walk, walk), world.client(Walk) as client:
        goal = await send(client, 5)
        assert (await goal.result()).done == 5
        assert [one.step async for one in goal] == [2, 3, 4]
        counts = client.statistics()
        assert (counts.sent, counts.accepted, counts.ended, counts.active) == (1, 1, 1, 0)
        assert (counts.feedback, counts.feedback_dropped) == (5, 2)


async def test_a_result_may_be_awaited_by_several_and_again() -> None:
    world = ActionWorld()
    async with world.server(Walk, walk), world.client(Walk) as client:
        goal = await send(client, 1)
        results = await asyncio.gather(goal.result(), goal.result())
        assert [one.done for one in results] == [1, 1]
        assert (await goal.result()).done == 1
        assert goal.is_done
        assert goal.status is GoalStatus.SUCCEEDED


async def test_feedback_of_a_goal_of_another_client_is_not_taken() -> None:
    world = ActionWorld()
    async with world.server(Walk, walk), world.client(Walk) as one, world.client(Walk) as other:
        await (await send(one, 3)).result()
        assert (one.statistics().feedback, other.statistics().feedback) == (3, 0)


async def test_nobody_serves() -> None:
    world = ActionWorld()
    async with world.client(Walk) as client:
        with pytest.raises(ActionUnavailable, match="no server exists now"):
            await send(client)
        assert client.statistics().sent == 0
    with pytest.raises(ConnectionClosed, match="is not open"):
        await send(client)


async def test_a_goal_is_sent_once() -> None:
    world = ActionWorld()
    async with world.server(Walk, forever), world.client(Walk) as client:
        await send(client, goal_id=bytes(16))
        with pytest.raises(LocalProtocolError, match="was sent already"):
            await send(client, goal_id=bytes(16))
        with pytest.raises(ConfigurationError, match="has 16 bytes, not 3"):
            await send(client, goal_id=b"abc")


async def test_a_server_that_leaves_before_it_answers_or_before_the_end() -> None:
    world = ActionWorld()
    async with world.client(Walk) as client:
        await world.server(Walk, forever).open()
        goal = await send(client)
        world.is_held = True
        sending = asyncio.ensure_future(send(client))
        await turns()
        world.lose_server()
        with pytest.raises(ActionUnavailable, match="before it answered"):
            await sending
        with pytest.raises(ActionUnavailable, match="before the goal's end"):
            await goal.result()
        with pytest.raises(ActionUnavailable, match="before the goal's end"):
            await goal.result()
        assert client.statistics().active == 0


async def test_the_end_of_a_goal_may_be_known_by_its_status_alone() -> None:
    world = ActionWorld()
    async with world.client(Walk) as client:
        await world.server(Walk, forever).open()
        goals = [await send(client) for _ in range(3)]
        for goal, status in zip(
            goals, (GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.SUCCEEDED), strict=True
        ):
            goal.status = status
        world.lose_server()
        kinds = []
        for goal in goals:
            with pytest.raises((GoalAborted, GoalCanceled, ActionUnavailable)) as caught:
                await goal.result()
            kinds.append(caught.type)
        # The result of the succeeded goal is lost.
        assert kinds == [GoalAborted, GoalCanceled, ActionUnavailable]


async def test_a_status_that_comes_late_takes_nothing_back() -> None:
    world = ActionWorld()
    async with world.server(Walk, forever) as server, world.client(Walk) as client:
        goal = await send(client)
        await turns()
        assert goal.status is GoalStatus.EXECUTING
        message = world.publishers[f"{NAME}/_action/status"].published[-1]
        message.status_list[0].status = int(GoalStatus.ACCEPTED)
        client._take_status(message)
        assert goal.status is GoalStatus.EXECUTING
        assert len(server.goals) == 1


async def test_a_goal_that_nobody_waits_for_any_more_is_canceled_when_it_is_accepted() -> None:
    world = ActionWorld()
    async with world.server(Walk, forever) as server, world.client(Walk) as client:
        world.is_held = True
        sending = asyncio.ensure_future(send(client))
        await turns()
        sending.cancel()
        await turns()
        world.release()
        await turns()
        assert (server.statistics().accepted, server.statistics().canceled) == (1, 1)


async def test_what_is_lost_with_busd_is_asked_again_if_that_changes_nothing() -> None:
    """The client repeats a request for a result or a cancellation. It does not repeat a goal, which may run
    already.
    """
    world = ActionWorld()
    async with world.server(Walk, forever) as server, world.client(Walk) as client:
        goal = await send(client)
        world.is_held = True
        sending = asyncio.ensure_future(send(client))
        canceling = asyncio.ensure_future(goal.cancel())
        await turns()
        world.lose_busd()
        with pytest.raises(ActionUnavailable, match="busd, or a connection to it, has ended meanwhile"):
            await sending
        world.release()
        assert await canceling
        with pytest.raises(GoalCanceled):
            await goal.result()
        assert server.statistics().accepted == 1


async def test_closing_ends_the_wait_for_a_result() -> None:
    world = ActionWorld()
    async with world.server(Walk, forever):
        async with world.client(Walk) as client:
            goal = await send(client)
            await turns()
            waiting = asyncio.ensure_future(goal.result())
            await turns()
        with pytest.raises(ConnectionClosed):
            await waiting
        await client.close()


async def test_a_server_is_ready_with_all_its_endpoints() -> None:
    world = ActionWorld()
    async with world.server(Walk, walk), world.client(Walk) as client:
        assert client.server_is_ready()
        parts: list[dict[str, Any]] = [world.services, world.publishers]
        for made in parts:
            for name in tuple(made):
                missing = made.pop(name)
                assert not client.server_is_ready(), name
                made[name] = missing
        assert client.server_is_ready()


async def test_feedback_that_was_not_read_before_the_result_belongs_to_the_goal() -> None:
    world = ActionWorld()
    world.is_unread = True
    async with world.server(Walk, walk), world.client(Walk) as client:
        goal = await send(client, 3)
        assert (await goal.result()).done == 3
        assert [one.step async for one in goal] == [0, 1, 2]


async def test_a_result_comes_after_the_feedback_of_its_turn() -> None:
    world = ActionWorld()

    async def walk_late(goal: ServerGoal) -> Any:
        await turns()  # the client has asked for the result
        return await walk(goal)

    async with world.server(Walk, walk_late), world.client(Walk) as client:
        goal = await send(client, 3)
        assert [one.step async for one in goal] == [0, 1, 2]
        assert client.statistics().feedback == 3


async def test_a_cancelled_call_whose_goal_is_accepted_during_the_close() -> None:
    world = ActionWorld()
    async with world.server(Walk, walk):
        client = world.client(Walk)
        await client.open()
        world.is_held = True
        sending = asyncio.ensure_future(send(client))
        await turns()
        sending.cancel()
        await turns()
        ends, client._ends = client._ends, None  # as the close does first
        world.release()
        await turns()
        assert ends is not None
        await ends.close()
    assert world.client_node.errors == []
    (warning,) = world.client_node.logger.warnings
    assert "can't be canceled: action client '/act' is not open" in warning
