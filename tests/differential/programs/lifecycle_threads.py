"""A lifecycle node in several threads: callbacks wait for a service, an action server comes and goes."""

import threading

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from test_msgs.action import Fibonacci
from test_msgs.srv import Empty


class Worker(LifecycleNode):
    def __init__(self):
        super().__init__("worker")
        self.group = ReentrantCallbackGroup()

    def on_configure(self, state):
        self.server = ActionServer(self, Fibonacci, "fibonacci", self.execute, callback_group=self.group)
        self.helper = self.create_client(Empty, "help", callback_group=self.group)
        print("  helper there", self.helper.wait_for_service(timeout_sec=10))
        print("  helper says", self.helper.call(Empty.Request()))
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state):
        self.server.destroy()
        print("  client destroyed", self.destroy_client(self.helper))
        return TransitionCallbackReturn.SUCCESS

    def execute(self, goal_handle):
        goal_handle.succeed()
        return Fibonacci.Result(sequence=range(goal_handle.request.order))


rclpy.init()
worker, helper, asking = Worker(), rclpy.create_node("helper"), rclpy.create_node("asking")
helper.create_service(Empty, "help", lambda request, response: response)
executors = MultiThreadedExecutor(3), SingleThreadedExecutor()
for executor, nodes in zip(executors, ((worker, helper), (asking,)), strict=True):
    for node in nodes:
        executor.add_node(node)
threads = [threading.Thread(target=executor.spin) for executor in executors]
for thread in threads:
    thread.start()

change = asking.create_client(ChangeState, "/worker/change_state")
state = asking.create_client(GetState, "/worker/get_state")
print(change.wait_for_service(timeout_sec=10), state.wait_for_service(timeout_sec=10))


def ask(label):
    done = change.call(ChangeState.Request(transition=Transition(label=label)))
    print(label, done.success, state.call(GetState.Request()).current_state)


for _ in range(2):
    ask("configure")
    ask("activate")
    client = ActionClient(asking, Fibonacci, "fibonacci")
    print(client.wait_for_server(timeout_sec=10))
    answer = client.send_goal(Fibonacci.Goal(order=3))
    print(answer.status, answer.result.sequence)
    client.destroy()
    ask("deactivate")
    ask("cleanup")
ask("shutdown")
ask("configure")
for executor in executors:
    executor.shutdown()
for thread in threads:
    thread.join()
for node in (worker, helper, asking):
    node.destroy_node()
rclpy.shutdown()
