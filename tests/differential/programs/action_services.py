"""Actions by their services and topics: requests without a client, states as published, deferred goals."""

import rclpy
from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.action import ActionServer, CancelResponse
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from show import attempt, until
from test_msgs.action import Fibonacci
from unique_identifier_msgs.msg import UUID

rclpy.init()
node = Node("action_services")
Impl = Fibonacci.Impl
print(sorted(name for name in vars(Impl) if name[0].isupper()))
for part in (Impl.SendGoalService.Request, Impl.SendGoalService.Response, Impl.GetResultService.Request):
    print(part())
for part in (Impl.GetResultService.Response, Impl.FeedbackMessage):
    print(part.get_fields_and_field_types(), part())
print(Impl.CancelGoalService is CancelGoal, Impl.GoalStatusMessage is GoalStatusArray)
attempt("made", Fibonacci)
attempt("made of it", Impl)

accepted, states = [], {}


def execute(goal_handle):
    if goal_handle.is_cancel_requested:
        goal_handle.canceled()
    else:
        goal_handle.succeed()
    return Fibonacci.Result(sequence=[goal_handle.request.order])


def take_status(message):
    for one in message.status_list:
        of_goal = states.setdefault(int(one.goal_info.goal_id.uuid[0]), [])
        if of_goal[-1:] != [one.status]:
            of_goal.append(one.status)


server = ActionServer(
    node,
    Fibonacci,
    "fibonacci",
    execute,
    handle_accepted_callback=accepted.append,
    cancel_callback=lambda goal_handle: CancelResponse.ACCEPT,
)
begin = "fibonacci/_action/"
sending = node.create_client(Impl.SendGoalService, f"{begin}send_goal")
results = node.create_client(Impl.GetResultService, f"{begin}get_result")
cancels = node.create_client(Impl.CancelGoalService, f"{begin}cancel_goal")
feedback = []
node.create_subscription(Impl.FeedbackMessage, f"{begin}feedback", feedback.append, 10)
node.create_subscription(
    Impl.GoalStatusMessage, f"{begin}status", take_status, qos_profile_action_status_default
)
print([one.wait_for_service(timeout_sec=10.0) for one in (sending, results, cancels)])


def spin():
    rclpy.spin_once(node, timeout_sec=0.1)


def call(client, request):
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    return future.result()


def send(number):
    request = Impl.SendGoalService.Request(goal_id=UUID(uuid=[number] * 16))
    request.goal.order = number
    return call(sending, request).accepted


def cancel(number=None, stamp=None):
    request = CancelGoal.Request()
    if number is not None:
        request.goal_info.goal_id = UUID(uuid=[number] * 16)
    if stamp is not None:
        request.goal_info.stamp = stamp
    response = call(cancels, request)
    return response.return_code, sorted(int(one.goal_id.uuid[0]) for one in response.goals_canceling)


def reached(number, status):
    print(number, until(lambda: states.get(number, [])[-1:] == [status], spin), states[number][-1])


print([send(number) for number in range(1, 6)], send(1))
print([handle.status for handle in accepted])
waiting = results.call_async(Impl.GetResultService.Request(goal_id=UUID(uuid=[1] * 16)))
accepted[0].execute()
rclpy.spin_until_future_complete(node, waiting, timeout_sec=10.0)
print(waiting.result())
reached(1, 4)
print("one", cancel(2), "again", cancel(2), "ended", cancel(1), "unknown", cancel(77))
print("until a time", cancel(stamp=accepted[3]._goal_info.stamp))
print("all", cancel())
print([handle.status for handle in accepted])
for handle in accepted[1:]:
    handle.execute()
for number in range(2, 6):
    reached(number, 5)
    response = call(results, Impl.GetResultService.Request(goal_id=UUID(uuid=[number] * 16)))
    print(response.status, list(response.result.sequence))
attempt("executed again", accepted[0].execute)
print("nothing left", cancel(), feedback)
server.destroy()
node.destroy_node()
rclpy.shutdown()
