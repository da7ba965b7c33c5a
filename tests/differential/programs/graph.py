"""A node's view of the graph: names and types, counts, nodes, and errors for wrong names."""

import rclpy
from show import attempt, until
from test_msgs.msg import BasicTypes, Strings
from test_msgs.srv import Empty

rclpy.init()
node = rclpy.create_node("here", namespace="/space")
other = rclpy.create_node("there", enable_rosout=False, start_parameter_services=False)
publisher = node.create_publisher(Strings, "chatter", 1)
hidden = node.create_publisher(Strings, "_hidden", 1)
subscription = other.create_subscription(BasicTypes, "/space/numbers", print, 1)
service = node.create_service(Empty, "serve", print)
client = other.create_client(Empty, "/space/serve")


def all_seen():
    return (
        node.count_subscribers("numbers")
        and other.count_publishers("/space/chatter")
        and ("there", "/") in node.get_node_names_and_namespaces()
        and other.get_service_names_and_types_by_node("here", "/space")
        and node.get_client_names_and_types_by_node("there", "/")
    )


until(all_seen)
ours = ("/space/chatter", "/space/_hidden", "/space/numbers", "/rosout", "/parameter_events")
print(sorted(one for one in node.get_topic_names_and_types() if one[0] in ours))
print([one for one in node.get_service_names_and_types() if one[0] == "/space/serve"])
print(sorted(node.get_node_names()), sorted(node.get_node_names_and_namespaces()))
print(sorted(node.get_node_names_and_namespaces_with_enclaves()))
print(sorted(node.get_fully_qualified_node_names()))
print(node.get_publisher_names_and_types_by_node("here", "/space"))
print(node.get_subscriber_names_and_types_by_node("there", "/"))
print(node.get_client_names_and_types_by_node("there", "/"))
for name in ("chatter", "/chatter", "numbers", "/space/serve", "bad name", "a//b", "{x}"):
    attempt(f"publishers of {name}", node.count_publishers, name)
    attempt(f"subscribers of {name}", node.count_subscribers, name)
    attempt(f"services of {name}", node.count_services, name)
    attempt(f"clients of {name}", node.count_clients, name)
    attempt(f"publishers by {name}", lambda name=name: len(node.get_publishers_info_by_topic(name)))
    attempt(f"subscriptions by {name}", lambda name=name: len(node.get_subscriptions_info_by_topic(name)))
attempt("no such node", node.get_publisher_names_and_types_by_node, "nobody", "/")
attempt("no such node", node.get_service_names_and_types_by_node, "here", "/")
attempt("no node's name", node.get_client_names_and_types_by_node, "a b", "/")
attempt("no namespace", node.get_subscriber_names_and_types_by_node, "here", "space//")
(info,) = node.get_publishers_info_by_topic("chatter")
print(info.node_name, info.node_namespace, info.topic_type, info.endpoint_type, info.qos_profile)
print(len(info.endpoint_gid), str(info).splitlines()[:3])
print(
    node.wait_for_node("/there", 0.0),
    node.wait_for_node("/space/here", 1.0),
    node.wait_for_node("nobody", 0.0),
)
node.destroy_node()
other.destroy_node()
rclpy.shutdown()
