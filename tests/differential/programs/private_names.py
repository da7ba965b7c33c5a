"""Names with an underscore, of nodes and executors, that programs and tests read."""

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import SingleThreadedExecutor, TimeoutException, TimeoutObject
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from show import attempt
from test_msgs.msg import Strings
from test_msgs.srv import Empty

rclpy.init()
node = rclpy.create_node("private")
node.declare_parameter("speed", 2.5)
print(sorted(node._parameters), node._parameters["speed"].value, node._descriptors["speed"].type)
publisher = node.create_publisher(Strings, "chatter", 10)
subscription = node.create_subscription(Strings, "chatter", print, 10)
client = node.create_client(Empty, "empty")
service = node.create_service(Empty, "empty", lambda request, response: response)
timer = node.create_timer(10, print)
guard = node.create_guard_condition(print)
print(publisher in node._publishers, subscription in node._subscriptions, client in node._clients)
print(service in node._services, timer in node._timers, guard in node._guards)


def allow(parameters):
    return SetParametersResult(successful=True)


node.add_on_set_parameters_callback(allow)
print(allow in node._on_set_parameters_callbacks, list(node._pre_set_parameters_callbacks))
attempt("none such", lambda: node._nothing)


class Own(Node):
    """A node that uses such names itself."""

    def __init__(self):
        super().__init__("own")
        self._period = 3


print(Own()._period)

executor = SingleThreadedExecutor()
executor.add_node(node)
print(executor._guard is None, executor._guard.callback)
executor._guard.trigger()
limit = TimeoutObject(0.01)
print(limit.timeout)
limit.timeout = 0.0
try:
    executor.wait_for_ready_callbacks(timeout_sec=limit)
except TimeoutException:
    print("TimeoutException")
executor.shutdown()
print(executor._guard)

states = LifecycleNode("states")
print([one.topic for one in states.publishers])
print(sorted(one.srv_name for one in states.services if one.srv_name.startswith("/")))
print(states._service_change_state in states.services, states._service_get_transition_graph.srv_name)
print(states._state_machine.current_state, states._state_machine.initialized, len(states._managed_entities))
print(sorted(states._callbacks))
print(node.count_publishers("/states/transition_event"))
rclpy.shutdown()
