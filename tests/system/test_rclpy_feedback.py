"""Feedback callbacks of rclpy's action clients end with their goals."""

from typing import Any

import pytest

from bus_actions import GoalStatus
from bus_ros.rclpy.action import ActionClient, ActionServer, CancelResponse
from bus_ros.rclpy.action import client as client_module
from bus_ros.rclpy.action.server import ServerGoalHandle
from bus_ros.rosidl import action_class
from conftest import WAIT_S
from rclpy_world import World, arguments, world

__all__ = ["arguments", "world"]

pytestmark = pytest.mark.usefixtures("route")

Fibonacci: Any = action_class("example_interfaces/action/Fibonacci")


def execute(goal_handle: ServerGoalHandle) -> Any:
    goal_handle.publish_feedback(Fibonacci.Feedback(sequence=[goal_handle.request.order]))
    goal_handle.succeed()
    return Fibonacci.Result()


def test_callbacks_of_ended_goals_do_not_pile_up(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of goals whose result is never asked for, of canceled ones, and of cancelled futures."""
    monkeypatch.setattr(client_module, "_MOST_ENDED", 2)
    node = world.node()
    executor = world.executor(node)
    held: list[ServerGoalHandle] = []
    told: list[int] = []

    def begin(goal_handle: ServerGoalHandle) -> None:
        if goal_handle.request.order:
            goal_handle.execute()
        else:
            held.append(goal_handle)

    def hear(message: Any) -> None:
        told.append(message.feedback.sequence[0])

    def done(future: Any) -> Any:
        world.spin_executor_until(future.done, executor)
        return future.result()

    ActionServer(
        *(node, Fibonacci, "fibonacci", execute),
        handle_accepted_callback=begin,
        cancel_callback=lambda _: CancelResponse.ACCEPT,
    )
    client = ActionClient(node, Fibonacci, "fibonacci")
    assert client.wait_for_server(timeout_sec=WAIT_S)
    canceled = done(client.send_goal_async(Fibonacci.Goal(order=0), hear))
    for order in (1, 2, 3, 4):
        goal_handle = done(client.send_goal_async(Fibonacci.Goal(order=order), hear))
        world.spin_executor_until(lambda one=goal_handle: one.status == GoalStatus.SUCCEEDED, executor)
    assert len(client._feedback_callbacks) == 3  # of `canceled`, too
    client.send_goal_async(Fibonacci.Goal(order=5), hear).cancel()
    world.spin_executor_until(lambda: 5 in told, executor)
    done(canceled.cancel_goal_async())
    held[0].canceled()
    world.spin_executor_until(lambda: bytes(canceled.goal_id.uuid) in client._ended, executor)
    assert len(client._feedback_callbacks) == len(client._ended) == 2
    goal_handle = done(client.send_goal_async(Fibonacci.Goal(order=6), hear))
    done(goal_handle.get_result_async())
    assert len(client._feedback_callbacks) == len(client._ended) <= 2
    assert told == [1, 2, 3, 4, 5, 6]
