"""Subscriptions and publishers: callbacks of one and two arguments, raw messages, counts and names."""

import rclpy
from rclpy.subscription import Subscription
from show import attempt, until
from test_msgs.msg import BasicTypes, Empty

rclpy.init(args=["program", "--ros-args", "--remap", "topic:=elsewhere"])
node = rclpy.create_node("subscribing", namespace="/space")
heard = []
publisher = node.create_publisher(BasicTypes, "numbers", 10)
subscription = node.create_subscription(BasicTypes, "numbers", heard.append, 10)
print(subscription._callback_type, subscription.callback == heard.append, subscription.raw)
print(node.create_publisher(Empty, "topic", 1).topic_name)
print(node.create_subscription(Empty, "topic", print, 1).topic_name)
print(node.create_subscription(Empty, "/space/topic", print, 1).topic_name)


def spin_until(count):
    until(lambda: len(heard) >= count, lambda: rclpy.spin_once(node, timeout_sec=0.1))
    found, heard[:] = heard[:], []
    return found


until(lambda: publisher.get_subscription_count())
until(lambda: subscription.get_publisher_count())
print(publisher.get_subscription_count(), subscription.get_publisher_count())
publisher.publish(BasicTypes(int32_value=1))
print([one.int32_value for one in spin_until(1)])
subscription.callback = lambda message, info: heard.append((message.int32_value, sorted(info)))
print(subscription._callback_type, type(subscription._callback_type) is Subscription.CallbackType)
publisher.publish(BasicTypes(int32_value=2))
print(spin_until(1))
for count in (0, 3):
    arguments = ", ".join("abc"[:count])
    wrong = eval(f"lambda {arguments}: None")
    attempt(f"{count} arguments", setattr, subscription, "callback", wrong)
    attempt(f"{count} arguments", node.create_subscription, BasicTypes, "numbers", wrong, 10)
raw = node.create_subscription(BasicTypes, "numbers", heard.append, 10, raw=True)
until(lambda: publisher.get_subscription_count() == 2)
node.destroy_subscription(subscription)
publisher.publish(BasicTypes(int32_value=3))
print([type(one).__name__ for one in spin_until(1)])
publisher.publish(BasicTypes())
print(publisher.wait_for_all_acked())
attempt("another type", publisher.publish, Empty())
attempt("a text", publisher.publish, "text")
attempt("a class", publisher.publish, BasicTypes)
print([int(one.event_type) for one in publisher.event_handlers])
print(len(raw.event_handlers))
rclpy.shutdown()
