"""Handles of a node's objects: in a `with`, after their destruction, and during their use."""

import rclpy
from rclpy.context import Context
from show import attempt
from test_msgs.msg import Empty
from test_msgs.srv import Empty as EmptyService

context = Context()
print(context.ok(), context.handle)
context.init()
print(context.ok(), context.handle is not None, isinstance(context.get_domain_id(), int))
attempt("again", context.init)
node = rclpy.create_node("handles", context=context)
made = {
    "node": node,
    "publisher": node.create_publisher(Empty, "topic", 1),
    "subscription": node.create_subscription(Empty, "topic", print, 1),
    "client": node.create_client(EmptyService, "service"),
    "service": node.create_service(EmptyService, "service", print),
    "timer": node.create_timer(1.0, print),
    "guard": node.create_guard_condition(print),
    "clock": node.get_clock(),
}
for name, one in made.items():
    with one.handle:
        print(name, hasattr(one.handle, "pointer"), hasattr(one.handle, "destroy_when_not_in_use"))
print(
    [getattr(made[name], "logger_name", None) for name in ("publisher", "subscription", "client", "service")]
)


def entered(one):
    with one.handle:
        return "entered"


def publish_while_held():
    with publisher.handle:
        publisher.handle.destroy_when_not_in_use()
        attempt("inside", publisher.publish, Empty())
    publisher.publish(Empty())


publisher = made["publisher"]
attempt("held", publish_while_held)
attempt("destroyed", entered, publisher)
attempt("topic", lambda: publisher.topic_name)
attempt("twice", publisher.handle.destroy_when_not_in_use)
for name in ("subscription", "client", "service", "timer", "guard"):
    made[name].destroy()
    attempt(name, entered, made[name])
attempt("trigger", made["guard"].trigger)
attempt("ready", made["client"].service_is_ready)
attempt("call", made["client"].call_async, EmptyService.Request())
attempt("count", made["subscription"].get_publisher_count)
attempt("cancel", made["timer"].cancel)
node.destroy_node()
attempt("node", entered, node)
attempt("name", node.get_name)
attempt("node again", node.destroy_node)
attempt("publisher of it", node.create_publisher, Empty, "t", 1)
attempt("subscription of it", node.create_subscription, Empty, "t", print, 1)
attempt("client of it", node.create_client, EmptyService, "t")
attempt("service of it", node.create_service, EmptyService, "t", print)
attempt("names of it", node.get_node_names)
attempt("timer of it", lambda: type(node.create_timer(1.0, print)).__name__)
attempt("shutdown", context.shutdown)
attempt("shutdown again", context.shutdown)
attempt("tried", context.try_shutdown)
attempt("domain", context.get_domain_id)
attempt("destroy", context.destroy)
attempt("ok", context.ok)
attempt("destroy again", context.destroy)
attempt("init", context.init)
other = Context()
attempt("never begun", other.shutdown)
attempt("never begun", other.try_shutdown)
attempt("never begun", other.get_domain_id)
attempt("never begun", other.destroy)
attempt("no context", rclpy.create_node, "n", context=other)
attempt("domain below zero", other.init, domain_id=-1)
with Context() as third:
    print(third.ok())
print(third.ok())
