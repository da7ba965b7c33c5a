"""The service ~/get_type_description and its parameter: descriptions of the types that a node uses."""

import rclpy
from rclpy.parameter import Parameter
from show import attempt
from test_msgs.msg import Builtins, Defaults, Strings
from test_msgs.srv import BasicTypes
from type_description_interfaces.srv import GetTypeDescription

rclpy.init()
node = rclpy.create_node("typed", namespace="/space")
print(node.get_parameter("start_type_description_service").value)
print(node.describe_parameter("start_type_description_service"))
attempt("setting it", node.set_parameters, [Parameter("start_type_description_service", value=False)])
publishers = [node.create_publisher(one, one.__name__.lower(), 1) for one in (Strings, Defaults, Builtins)]
service = node.create_service(BasicTypes, "serve", print)
client = node.create_client(GetTypeDescription, "~/get_type_description")
print(client.srv_name, [one for one in node.get_service_names_and_types() if "type_desc" in one[0]])
print(client.wait_for_service(5.0))


def ask(name, hash_="", sources=True):
    future = client.call_async(
        GetTypeDescription.Request(type_name=name, type_hash=hash_, include_type_sources=sources)
    )
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    return future.result()


def hash_of(topic):
    (info,) = node.get_publishers_info_by_topic(topic)
    return str(info.topic_type_hash)


for name, topic in (("test_msgs/msg/Defaults", "defaults"), ("test_msgs/msg/Builtins", "builtins")):
    found = ask(name, hash_of(topic))
    print(name, found.successful, repr(found.failure_reason), found.extra_information)
    described = found.type_description.type_description
    print(described.type_name)
    for field in described.fields:
        print(" ", field.name, field.type, repr(field.default_value))
    print([one.type_name for one in found.type_description.referenced_type_descriptions])
    print([(one.type_name, one.encoding) for one in found.type_sources])
    print(len(ask(name, hash_of(topic), sources=False).type_sources))
for name, hash_ in (
    ("test_msgs/msg/Defaults", ""),
    ("test_msgs/msg/Defaults", "RIHS01_" + "0" * 64),
    ("test_msgs/msg/Defaults", "nonsense"),
    ("test_msgs/msg/Arrays", hash_of("defaults")),
    ("test_msgs/msg/Nobody", "RIHS01_" + "0" * 64),
    ("", hash_of("strings")),
    ("test_msgs/msg/Strings", hash_of("strings")),
    ("test_msgs/srv/BasicTypes_Request", ""),
):
    found = ask(name, hash_)
    print(
        repr(name),
        hash_[:10],
        found.successful,
        repr(found.failure_reason),
        found.type_description.type_description.type_name,
    )
off = rclpy.create_node("off", parameter_overrides=[Parameter("start_type_description_service", value=False)])
print(off.get_parameter("start_type_description_service").value)
print([one for one in off.get_service_names_and_types_by_node("off", "/") if "type_desc" in one[0]])
attempt(
    "wrong type",
    lambda: rclpy.create_node(
        "wrong", parameter_overrides=[Parameter("start_type_description_service", value=3)]
    ).get_name(),
)
rclpy.shutdown()
