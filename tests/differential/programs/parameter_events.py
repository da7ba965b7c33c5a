"""ParameterEventHandler: callbacks for one parameter and for all, their order, removal and errors."""

import rclpy
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.parameter_event_handler import ParameterEventHandler
from show import attempt, until

rclpy.init()
node = rclpy.create_node("target", namespace="/space")
other = rclpy.create_node("other", namespace="/space")
handler = ParameterEventHandler(node)
for one in (node, other):
    one.declare_parameter("int", 0)
    one.declare_parameter("text", "")
heard = []


def hear(label):
    return lambda found: heard.append((label, *shown(found)))


def shown(found):
    if isinstance(found, ParameterEvent):
        return found.node, len(found.changed_parameters)
    return type(found).__name__, found.name, found.value.integer_value


executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(other)


def said(count):
    until(lambda: len(heard) >= count, lambda: executor.spin_once(timeout_sec=0.05))
    for _ in range(3):
        executor.spin_once(timeout_sec=0.02)
    found, heard[:] = heard[:], []
    return found


said(2)
first = handler.add_parameter_callback("int", "target", hear("first"))
second = handler.add_parameter_callback("int", "/space/target", hear("second"))
away = handler.add_parameter_callback("int", "/space/other", hear("other"))
every = handler.add_parameter_event_callback(hear("every"))
late = handler.add_parameter_event_callback(hear("late"))
print(first.parameter_name, first.node_name, second.node_name, away.node_name, type(every).__name__)
node.set_parameters([Parameter("int", value=1)])
print(said(4))
other.set_parameters([Parameter("int", value=2)])
print(said(3))
node.set_parameters([Parameter("text", value="x")])
print(said(2))
handler.remove_parameter_callback(first)
handler.remove_parameter_event_callback(late)
node.set_parameters([Parameter("int", value=3)])
print(said(2))
attempt("removed twice", handler.remove_parameter_callback, first)
attempt("removed twice", handler.remove_parameter_event_callback, late)

event = ParameterEvent(node="/space/target")
event.new_parameters = [Parameter("new", value=1).to_parameter_msg()]
event.changed_parameters = [Parameter("changed", value=[1.5]).to_parameter_msg()]
event.deleted_parameters = [Parameter("gone", value=True).to_parameter_msg()]
names = ("new", "changed", "gone", "none")
for name in names:
    found = ParameterEventHandler.get_parameter_from_event(event, name, "/space/target")
    print(name, None if found is None else (type(found).__name__, found.name, found.value.type))
print(ParameterEventHandler.get_parameter_from_event(event, "new", "/other"))
print([one.name for one in ParameterEventHandler.get_parameters_from_event(event)])

client = AsyncParameterClient(other, "/space/target")
subscription = client.on_parameter_event(hear("client"))
until(lambda: subscription.get_publisher_count() >= 2)
node.set_parameters([Parameter("int", value=4)])
print(sorted(said(3)))
handler.destroy()
node.set_parameters([Parameter("int", value=5)])
print(said(1))
rclpy.shutdown()
