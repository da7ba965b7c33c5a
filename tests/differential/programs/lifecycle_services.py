"""Lifecycle nodes from outside: their services, transition events, and requests that fail."""

import rclpy
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from show import attempt, until


class Managed(LifecycleNode):
    result = TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        return self.result


rclpy.init()
node, asking = Managed("managed", namespace="/robot"), rclpy.create_node("asking")
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(asking)
clients = {
    name: asking.create_client(kind, f"/robot/managed/{name}")
    for name, kind in {
        "change_state": ChangeState,
        "get_state": GetState,
        "get_available_states": GetAvailableStates,
        "get_available_transitions": GetAvailableTransitions,
        "get_transition_graph": GetAvailableTransitions,
    }.items()
}
print([client.wait_for_service(timeout_sec=10) for client in clients.values()])
events = []
subscription = asking.create_subscription(
    TransitionEvent, "/robot/managed/transition_event", events.append, 20
)
print(until(lambda: subscription.get_publisher_count() == 1))


def ask(name, **fields):
    client = clients[name]
    future = client.call_async(client.srv_type.Request(**fields))
    until(future.done, lambda: executor.spin_once(timeout_sec=0.1))
    return future.result()


def change(**fields):
    answer = attempt(f"change_state {fields}", ask, "change_state", transition=Transition(**fields))
    state = ask("get_state").current_state
    print(f"  {answer.success if answer else answer}, {state.label} [{state.id}]")


def descriptions(answer):
    for one in answer.available_transitions:
        print(f"  {one.transition}: {one.start_state} to {one.goal_state}")


print(ask("get_state"))
print(ask("get_available_states"))
descriptions(ask("get_available_transitions"))
descriptions(ask("get_transition_graph"))
change(id=Transition.TRANSITION_CONFIGURE)
descriptions(ask("get_available_transitions"))
change(label="activate")
change(id=Transition.TRANSITION_CONFIGURE, label="deactivate")
for result in (TransitionCallbackReturn.FAILURE, TransitionCallbackReturn.ERROR):
    node.result = result
    change(label="activate")
    print(node.trigger_configure() if result == TransitionCallbackReturn.ERROR else "")
node.result = TransitionCallbackReturn.SUCCESS
change(label="nonsense")
change(label="transition_success")
change(id=Transition.TRANSITION_INACTIVE_SHUTDOWN)
descriptions(ask("get_available_transitions"))
change(label="shutdown")
print(until(lambda: len(events) == 15, lambda: executor.spin_once(timeout_sec=0.1)), len(events))
for event in events:
    print(f"{event.start_state} to {event.goal_state}")
print(events[0].transition, events[0].timestamp > 0)
info = asking.get_publishers_info_by_topic("/robot/managed/transition_event")
print(
    [
        (one.node_name, one.topic_type, one.qos_profile.reliability.name, one.qos_profile.durability.name)
        for one in info
    ]
)
change(id=Transition.TRANSITION_ACTIVATE)
change(id=255)
node.destroy_node()
asking.destroy_node()
rclpy.shutdown()
