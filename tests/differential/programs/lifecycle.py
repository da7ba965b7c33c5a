"""Lifecycle nodes: transitions, callbacks and their results, managed entities, publishers."""

from types import MappingProxyType

import rclpy
from rclpy import lifecycle
from rclpy.lifecycle import (
    LifecycleNode,
    LifecycleNodeMixin,
    LifecycleState,
    ManagedEntity,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)
from rclpy.node import Node
from show import attempt, until
from test_msgs.msg import BasicTypes

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)
VERBS = ("configure", "activate", "deactivate", "cleanup", "shutdown")

print(SUCCESS, repr(FAILURE), int(ERROR), SUCCESS == 97, SUCCESS.name, FAILURE.value, ERROR.to_label())
print([issubclass(one, ManagedEntity) for one in (LifecycleNode, lifecycle.LifecyclePublisher)])
print(
    lifecycle.Node is LifecycleNode,
    lifecycle.State is LifecycleState,
    lifecycle.NodeMixin is LifecycleNodeMixin,
)
print(LifecycleState("active", 3), LifecycleState(state_id=3, label="active") == ("active", 3))

rclpy.init()


class Recorder(LifecycleNode):
    """Prints each call, and returns the prepared result."""

    results = MappingProxyType({})

    def answer(self, name, state):
        print(f"  {name}: {state}, now {self._state_machine.current_state}")
        result = self.results.get(name, SUCCESS)
        if isinstance(result, Exception):
            raise result
        return result

    def on_configure(self, state):
        return self.answer("on_configure", state)

    def on_activate(self, state):
        return self.answer("on_activate", state)

    def on_deactivate(self, state):
        return self.answer("on_deactivate", state)

    def on_cleanup(self, state):
        return self.answer("on_cleanup", state)

    def on_shutdown(self, state):
        return self.answer("on_shutdown", state)

    def on_error(self, state):
        return self.answer("on_error", state)


def recorder(*verbs):
    """A recorder that has made these transitions."""
    node = Recorder("recorder", enable_communication_interface=False, start_parameter_services=False)
    for verb in verbs:
        getattr(node, f"trigger_{verb}")()
    return node


node = recorder()
machine = node._state_machine
print(machine.initialized, machine.available_states)
for one in machine.transition_graph:
    print(one)
for verb in VERBS:
    print(machine.current_state, machine.available_transitions)
    attempt(verb, getattr(node, f"trigger_{verb}"))
print(machine.current_state, machine.available_transitions)
for verb in VERBS:
    attempt(f"finalized: {verb}", getattr(node, f"trigger_{verb}"))
attempt("destroyed", node.destroy_node)

for state, before in (
    ("unconfigured", ()),
    ("inactive", ("configure",)),
    ("active", ("configure", "activate")),
):
    for verb in VERBS:
        node = recorder(*before)
        attempt(f"{state}: {verb}", getattr(node, f"trigger_{verb}"))
        print(node._state_machine.current_state)
        node.destroy_node()

for before, verb in (
    ((), "configure"),
    (("configure",), "activate"),
    (("configure", "activate"), "deactivate"),
    (("configure",), "cleanup"),
    (("configure", "activate"), "shutdown"),
):
    for result in (FAILURE, ERROR, ValueError("no")):
        for of_error in (SUCCESS, FAILURE, ERROR, KeyError("worse")) if result != FAILURE else (SUCCESS,):
            node = recorder(*before)
            node.results = {f"on_{verb}": result, "on_error": of_error}
            attempt(f"{verb}: {result!r}, {of_error!r}", getattr(node, f"trigger_{verb}"))
            print(node._state_machine.current_state)
            node.destroy_node()


class Entity(ManagedEntity):
    def __init__(self, name, result):
        self.name, self.result = name, result

    def on_activate(self, state):
        print(f"  {self.name}: {state}")
        return self.result


node = LifecycleNode("entities")
entities = [Entity("first", SUCCESS), Entity("second", SUCCESS)]
attempt("no entity", node.add_managed_entity, 3)
attempt("first", node.add_managed_entity, entities[0])
node.trigger_configure()
for result in (FAILURE, SUCCESS, None):
    entities[0].result = result
    attempt(f"activate, {result}", node.trigger_activate)
    print(node._state_machine.current_state)
    if result is SUCCESS:
        node.trigger_deactivate()
print([getattr(ManagedEntity(), f"on_{verb}")(None) for verb in (*VERBS, "error")])


class Motor(SimpleManagedEntity):
    @SimpleManagedEntity.when_enabled
    def run(self, speed, *, way="ahead"):
        """Runs."""
        print("  runs", speed, way)
        return speed

    @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: print("  is off"))
    def stop(self):
        print("  stops")


motor = Motor()
print(Motor.run.__name__, Motor.run.__doc__, motor.is_activated)
for change in (motor.on_activate, motor.on_deactivate, motor.on_configure):
    attempt("run", motor.run, 3, way="back")
    attempt("stop", motor.stop)
    print(change(LifecycleState("any", 0)), motor.is_activated)

node = LifecycleNode("publishing")
heard = []
listener = rclpy.create_node("listener")
listener.create_subscription(BasicTypes, "numbers", lambda message: heard.append(message.int32_value), 10)
publisher = node.create_lifecycle_publisher(BasicTypes, "numbers", 10)
ordinary = node.create_publisher(BasicTypes, "numbers", 10)
print(type(ordinary).__name__, type(publisher).__name__, isinstance(publisher, SimpleManagedEntity))
print(until(lambda: publisher.get_subscription_count() and ordinary.get_subscription_count()))


def publish(number):
    attempt(f"publish {number}", publisher.publish, BasicTypes(int32_value=number))


publish(1)
attempt("publish nonsense", publisher.publish, "nonsense")
node.trigger_configure()
publish(2)
node.trigger_activate()
publish(3)
attempt("publish nonsense", publisher.publish, 3)
node.trigger_deactivate()
publish(4)
ordinary.publish(BasicTypes(int32_value=5))
node.trigger_activate()
publish(6)
print(until(lambda: len(heard) == 3, lambda: rclpy.spin_once(listener, timeout_sec=0.1)), sorted(heard))
attempt("another class", node.create_lifecycle_publisher, BasicTypes, "numbers", 10, publisher_class=int)
attempt("no type", node.create_lifecycle_publisher, BasicTypes, "a b", 10)
attempt("destroy", node.destroy_lifecycle_publisher, publisher)
attempt("again", node.destroy_lifecycle_publisher, publisher)
attempt("deactivate", node.trigger_deactivate)
attempt("destroy ordinary", node.destroy_publisher, ordinary)


class Own(LifecycleNodeMixin, Node):
    def __init__(self, **options):
        Node.__init__(self, "own")
        LifecycleNodeMixin.__init__(self, **options)


def services(one):
    return [service.srv_name for service in one.services if service.srv_name.startswith("/")]


print(services(Own(enable_communication_interface=False)))
print(services(Own(callback_group=rclpy.callback_groups.ReentrantCallbackGroup())))
print(services(LifecycleNode("placed", namespace="/ns/below")))


class Nested(LifecycleNode):
    def on_configure(self, state):
        attempt("nested", self.trigger_configure)
        return SUCCESS


attempt("around", Nested("nested").trigger_configure)
for flag in (1, None, "yes"):
    attempt(
        f"flag {flag}", lambda flag=flag: LifecycleNode("n", enable_communication_interface=flag).get_name()
    )
attempt("name", LifecycleNode, "a/b")
attempt("argument", LifecycleNode, "n", nonsense=1)
attempt("group", LifecycleNode, "n", callback_group=None)


class Wrong(LifecycleNode):
    def on_configure(self, state):
        return None


node = Wrong("wrong")
attempt("nothing returned", node.trigger_configure)
print(node._state_machine.current_state)
node.destroy_node()
node = LifecycleNode("after")
node.destroy_node()
attempt("after destroy", node.trigger_configure)
node = LifecycleNode("after")
rclpy.shutdown()
attempt("after shutdown", node.trigger_configure)
