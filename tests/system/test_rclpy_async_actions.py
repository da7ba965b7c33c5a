"""Actions of an AsyncNode on the test's daemon, by both routes and on both event loops."""

import asyncio
from typing import Any

import pytest

from bus_actions import ActionUnavailable, GoalCanceled, GoalRejected
from bus_ros.rclpy.action import CancelResponse, GoalResponse
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.experimental import AsyncNode
from bus_ros.rosidl import action_class
from rclpy_async_world import context, node
from semantics import until

__all__ = ["context", "node"]

pytestmark = pytest.mark.usefixtures("route", "context")

Fibonacci: Any = action_class("example_interfaces/action/Fibonacci")


class TestActions:
    @staticmethod
    async def count(goal: Any) -> Any:
        for number in range(goal.request.order):
            yield Fibonacci.Feedback(sequence=[number])
            await asyncio.sleep(0)
        yield Fibonacci.Result(sequence=list(range(goal.request.order)))

    async def test_a_goal(self, node: AsyncNode) -> None:
        node.create_action_server(
            Fibonacci,
            "count",
            self.count,
            goal_callback=lambda goal: GoalResponse.REJECT if goal.order > 9 else GoalResponse.ACCEPT,
        )
        client = node.create_action_client(Fibonacci, "count")
        await client.wait_for_server()
        got: list[int] = []
        goal = await client.send_goal(Fibonacci.Goal(order=3), lambda feedback: got.extend(feedback.sequence))
        assert list((await goal.result()).sequence) == [0, 1, 2]
        await until(lambda: got == [0, 1, 2])
        with pytest.raises(GoalRejected):
            await client.send_goal(Fibonacci.Goal(order=10))
        assert ("/count", ["example_interfaces/action/Fibonacci"]) in node.get_action_names_and_types()

    async def test_a_goal_waits_for_a_server_that_is_being_made(self, node: AsyncNode) -> None:
        early = node.create_action_client(Fibonacci, "count")
        await until(lambda: early.state.name == "OPEN")
        server = node.create_action_server(Fibonacci, "count", self.count)
        for client in (early, node.create_action_client(Fibonacci, "count")):
            goal = await client.send_goal(Fibonacci.Goal(order=1))
            assert list((await goal.result()).sequence) == [0]
        server.destroy()
        await until(lambda: not early.server_is_ready())
        with pytest.raises(ActionUnavailable):
            await early.send_goal(Fibonacci.Goal(order=1))

    async def test_a_canceled_goal(self, node: AsyncNode) -> None:
        ended: list[str] = []

        async def execute(goal: Any) -> Any:
            try:
                await asyncio.sleep(60)
            except asyncio.CancelledError:
                ended.append(goal.status.name)
                raise

        node.create_action_server(
            Fibonacci, "wait", execute, cancel_callback=lambda goal: CancelResponse.ACCEPT
        )
        client = node.create_action_client(Fibonacci, "wait")
        await client.wait_for_server()
        goal = await client.send_goal(Fibonacci.Goal(order=1))
        assert await goal.cancel()
        with pytest.raises(GoalCanceled):
            await goal.result()
        assert ended == ["CANCELING"]

    @pytest.mark.parametrize("is_open", [False, True])
    async def test_a_destroyed_client(self, node: AsyncNode, is_open: bool) -> None:
        client = node.create_action_client(Fibonacci, "nobody")
        waiting = asyncio.create_task(client.wait_for_server())
        if is_open:
            await client._opened()
        await asyncio.sleep(0)
        client.destroy()
        for call in (waiting, client.send_goal(Fibonacci.Goal(order=1))):
            with pytest.raises(InvalidHandle, match="the client of action 'nobody' is destroyed"):
                await call
