"""Events of liveliness and deadlines: at the match, the first sign of life, the end of a lease, and later."""

import rclpy
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile
from show import until
from test_msgs.msg import Strings

LEASE_S = 0.5
told = []
rclpy.init()
node = rclpy.create_node("liveliness")
spinner = rclpy.executors.SingleThreadedExecutor()
spinner.add_node(node)


def manual(lease_s):
    profile = QoSProfile(depth=5, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC)
    if lease_s:
        profile.liveliness_lease_duration = Duration(seconds=lease_s)
    return profile


def note(name):
    return lambda event: told.append((name, event))


def publish_to(topic, profile, name="publisher"):
    events = PublisherEventCallbacks(liveliness=note(name), deadline=note(name))
    return node.create_publisher(Strings, topic, profile, event_callbacks=events)


def subscribe(topic, profile, name="subscription"):
    def got(message):
        told.append((f"message of {name}", message.string_value))

    events = SubscriptionEventCallbacks(liveliness=note(name), deadline=note(name))
    return node.create_subscription(Strings, topic, got, profile, event_callbacks=events)


def show(label, count):
    """Wait for `count` events and a moment more, and print all by name."""
    until(lambda: len(told) >= count, lambda: spinner.spin_once(timeout_sec=0.01))
    for _ in range(5):
        spinner.spin_once(timeout_sec=0.01)
    print(label)
    for name, event in sorted(told, key=lambda one: one[0]):
        fields = [field for field in sorted(dir(event)) if field.endswith(("_count", "_count_change"))]
        values = " ".join(f"{field}={getattr(event, field)}" for field in fields)
        print(f"  {name}: {values or event}")
    told.clear()


def wait_for_match(publisher):
    until(lambda: publisher.get_subscription_count() == 1)


def wait(seconds):
    done = []
    timer = node.create_timer(seconds, lambda: done.append(True))
    until(lambda: done, lambda: spinner.spin_once(timeout_sec=0.01))
    node.destroy_timer(timer)


for topic, subscription_lease_s in (("same", LEASE_S), ("longer", 3 * LEASE_S)):
    print(topic)
    subscription = subscribe(topic, manual(subscription_lease_s))
    publisher = publish_to(topic, manual(LEASE_S))
    wait_for_match(publisher)
    wait(2 * LEASE_S)
    show("matched", 0)
    publisher.assert_liveliness()
    show("first sign", 1)
    show("end of the lease", 2)
    publisher.assert_liveliness()
    show("next sign", 1)
    show("end of the lease", 2)
    publisher.publish(Strings(string_value="text"))
    show("message", 2)
    show("end of the lease", 2)
    second = publish_to(topic, manual(LEASE_S))
    wait_for_match(second)
    wait(2 * LEASE_S)
    show("second matched", 0)
    node.destroy_publisher(second)
    show("second destroyed without a sign", 0)
    second = publish_to(topic, manual(LEASE_S), "second")
    wait_for_match(second)
    second.publish(Strings(string_value="second"))
    show("second's first message", 2)
    node.destroy_publisher(second)
    show("second destroyed, alive", 1)
    node.destroy_publisher(publisher)
    show("first destroyed, not alive", 1)
    node.destroy_subscription(subscription)

print("infinite")
subscription = subscribe("infinite", manual(0))
for lease_s in (0, LEASE_S):
    publisher = publish_to("infinite", manual(lease_s))
    wait_for_match(publisher)
    publisher.assert_liveliness()
    show("sign", 0)
    publisher.publish(Strings(string_value="text"))
    show("message", 1)
    if lease_s:
        show("end of the publisher's lease", 1)
    node.destroy_publisher(publisher)
    show("destroyed", 0)

print("deadline")
profile = QoSProfile(depth=5, deadline=Duration(seconds=LEASE_S))
subscription = subscribe("deadline", profile)
publisher = publish_to("deadline", profile)
wait_for_match(publisher)
wait(2 * LEASE_S)
show("before the first message", 0)
publisher.publish(Strings(string_value="text"))
show("message", 1)
show("one period", 2)
show("next period", 2)
wait(1.5 * LEASE_S)
show("two periods", 2)
publisher.publish(Strings(string_value="text"))
show("message", 1)
show("one period", 2)
node.destroy_publisher(publisher)
show("publisher destroyed", 1)
node.destroy_node()
rclpy.shutdown()
