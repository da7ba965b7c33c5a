"""The order of calls in one turn of an executor: tasks, timers, subscriptions, guards, clients, services."""

import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from show import until
from test_msgs.msg import BasicTypes as Message
from test_msgs.srv import BasicTypes as Service


def note(label):
    def callback(*arguments):
        order.append(label)
        return arguments[-1] if arguments else None

    return callback


rclpy.init()
order = []
other = rclpy.create_node("other")
other.create_service(Service, "there", note("there"))
serving = SingleThreadedExecutor()
serving.add_node(other)
thread = threading.Thread(target=serving.spin)
thread.start()

node = rclpy.create_node("node")
here, there = node.create_client(Service, "here"), node.create_client(Service, "there")
node.create_service(Service, "here", note("service"))
guard = node.create_guard_condition(note("guard condition"))
node.create_subscription(Message, "topic", note("subscription"), 10)
publisher = node.create_publisher(Message, "topic", 10)
until(
    lambda: publisher.get_subscription_count() == 1 and there.service_is_ready() and here.service_is_ready()
)
executor = SingleThreadedExecutor()
executor.add_node(node)
here.call_async(Service.Request())
there.call_async(Service.Request()).add_done_callback(note("client"))
until(lambda: "there" in order)
guard.trigger()
publisher.publish(Message())
timer = node.create_timer(0.1, note("timer"))
time.sleep(0.5)
executor.create_task(note("task"))
order.clear()
until(lambda: {"client", "service"} <= set(order), lambda: executor.spin_once(timeout_sec=1.0))
print([label for index, label in enumerate(order) if label not in order[:index]])

# Timers are on time under a load of messages, and messages come through beside a timer that is always due.
order.clear()
node.create_subscription(Message, "busy", lambda message: (order.append("busy"), busy.publish(message)), 10)
busy = node.create_publisher(Message, "busy", 10)
until(lambda: busy.get_subscription_count() == 1)
for _ in range(5):
    busy.publish(Message())
until(lambda: order.count("timer") >= 3, lambda: executor.spin_once(timeout_sec=1.0))
print(order.count("timer"), order.count("busy") > 5)
node.destroy_timer(timer)
node.create_timer(0.0, note("always"))
order.clear()
until(lambda: order.count("busy") >= 10, lambda: executor.spin_once(timeout_sec=1.0))
print(order.count("busy"), order.count("always") >= 5)

serving.shutdown()
thread.join(10.0)
rclpy.shutdown()
