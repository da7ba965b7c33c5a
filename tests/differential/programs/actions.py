"""Actions: answers to goals, feedback, results, cancellations, the states of handles, and refusals."""

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.graph import (
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.task import Future
from show import attempt, until
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

rclpy.init()
node = Node("actions")
asked = Future()
accepted = []
SUCCEED, RAISE, FORGET, ABORT, WAIT, REJECT, NO_ANSWER = range(1, 8)


async def execute(goal_handle):
    order = goal_handle.request.order
    print("execute", order, goal_handle.status, goal_handle.is_active, goal_handle.is_cancel_requested)
    goal_handle.publish_feedback(Fibonacci.Feedback(sequence=[0, order]))
    if order == SUCCEED:
        attempt("feedback of another class", goal_handle.publish_feedback, 5)
        attempt("canceled without a request", goal_handle.canceled)
        goal_handle.succeed()
        attempt("succeed again", goal_handle.succeed)
        attempt("abort after it", goal_handle.abort)
    elif order == RAISE:
        raise ValueError("boom")
    elif order == ABORT:
        goal_handle.abort()
    elif order == WAIT:
        await asked
        print("asked", goal_handle.status, goal_handle.is_cancel_requested)
        goal_handle.canceled()
    return Fibonacci.Result(sequence=[order])


def take_goal(goal):
    if goal.order == NO_ANSWER:
        return True
    return GoalResponse.REJECT if goal.order == REJECT else GoalResponse.ACCEPT


def take_cancel(goal_handle):
    asked.set_result(None)
    return CancelResponse.ACCEPT


attempt("no callback", ActionServer, node, Fibonacci, "fibonacci", None)
for name in ("", "1a", "a b"):
    attempt(f"client {name!r}", ActionClient, node, Fibonacci, name)
server = ActionServer(
    node,
    Fibonacci,
    "fibonacci",
    execute,
    goal_callback=take_goal,
    handle_accepted_callback=accepted.append,
    cancel_callback=take_cancel,
)
client = ActionClient(node, Fibonacci, "fibonacci")
print(client.wait_for_server(timeout_sec=10.0), client.server_is_ready())
print(server.get_num_entities(), client.get_num_entities())
print(get_action_names_and_types(node))
print(get_action_server_names_and_types_by_node(node, "actions", "/"))
print(get_action_client_names_and_types_by_node(node, "actions", "/"))
print([name for name, _ in sorted(node.get_service_names_and_types()) if "_action" in name])
print([name for name, _ in sorted(node.get_topic_names_and_types()) if "_action" in name])


def result_of(future):
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    return future.result()


def send(order):
    """Send a goal and print its events; returns the handle."""
    feedback = []
    goal_id = UUID(uuid=[order] * 16)
    future = client.send_goal_async(
        Fibonacci.Goal(order=order), lambda message: feedback.append(list(message.feedback.sequence)), goal_id
    )
    handle = result_of(future)
    print("goal", order, handle.accepted, handle.goal_id == goal_id, handle.stamp.sec > 0)
    if not handle.accepted:
        return handle
    accepted.pop().execute()
    if order == WAIT:
        until(lambda: feedback, lambda: rclpy.spin_once(node, timeout_sec=0.1))
        response = result_of(handle.cancel_goal_async())
        print("cancel", response.return_code, [one.goal_id == goal_id for one in response.goals_canceling])
    response = result_of(handle.get_result_async())
    until(lambda: handle.status == response.status, lambda: rclpy.spin_once(node, timeout_sec=0.1))
    print("result", response.status, list(response.result.sequence), feedback, handle.status)
    print("cancel after the end", result_of(handle.cancel_goal_async()))
    print("again", result_of(handle.get_result_async()).status)
    return handle


handles = [send(order) for order in range(SUCCEED, NO_ANSWER + 1)]
print("same id", send(SUCCEED).accepted)
print(handles[-1])
print(handles[0] == handles[0], handles[0] == handles[1], handles[0] != handles[1])
attempt("another class", lambda: handles[0] == 5)
attempt("no goal", client.send_goal_async, 5)
attempt("no goal, waiting", client.send_goal, Fibonacci.Result())
attempt("no handle", client._get_result_async, 5)
attempt("no handle to cancel", client._cancel_goal_async, None)
handles[0]._goal_id = UUID(uuid=[99] * 16)
print("unknown", result_of(handles[0].get_result_async()), result_of(handles[0].cancel_goal_async()))
print(accepted)
theirs = next(iter(server._goal_handles.values()))
attempt("accepted again", ServerGoalHandle, server, theirs._goal_info, Fibonacci.Goal())
server.destroy()
print(theirs.status, theirs.is_active, theirs.succeed())
attempt("destroyed again", server.destroy)
client.destroy()
node.destroy_node()
rclpy.shutdown()
