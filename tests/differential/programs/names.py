"""Invalid names of nodes, topics and services: the errors and their texts."""

import rclpy
from rclpy.expand_topic_name import expand_topic_name
from show import attempt
from test_msgs.msg import Empty
from test_msgs.srv import Empty as EmptyService

rclpy.init()
for name in ("", "1st", "a b", "a/b", "a-b", "a" * 256, "ok"):
    made = attempt(f"node {name[:9]!r}", lambda name=name: rclpy.create_node(name).get_name())
for namespace in ("/", "a", "/a/", "//a", "/1", "/a b", "a/b/c"):
    attempt(
        f"namespace {namespace!r}",
        lambda namespace=namespace: rclpy.create_node("n", namespace=namespace).get_namespace(),
    )
node = rclpy.create_node("names", namespace="/space")
for topic in (
    "chatter",
    "/chatter",
    "~/chatter",
    "~chatter",
    "a//b",
    "a/",
    "1a",
    "a b",
    "",
    "/",
    "{node}",
    "{x}",
    "a__b",
):
    attempt(
        f"topic {topic!r}",
        lambda topic=topic: node.create_publisher(Empty, topic, 1).topic_name,
    )
    attempt(
        f"service {topic!r}",
        lambda topic=topic: node.create_service(EmptyService, topic, print).srv_name,
    )
    attempt(f"resolved {topic!r}", node.resolve_topic_name, topic)
    attempt(f"expanded {topic!r}", expand_topic_name, topic, "node", "/space")
attempt("type", node.create_publisher, int, "topic", 1)
attempt("service type", node.create_client, Empty, "service")
attempt("topic type", node.create_subscription, EmptyService, "topic", print, 1)
attempt("depth", node.create_publisher, Empty, "topic", -1)
attempt("profile", node.create_publisher, Empty, "topic", "10")
node.destroy_node()
rclpy.shutdown()
