"""Service introspection: the events on _service_event, off, metadata only and with contents."""

import rclpy
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState
from show import attempt, until
from test_msgs.srv import BasicTypes

KINDS = ("request sent", "request received", "response sent", "response received")


def serve(request, response):
    response.bool_value = not request.bool_value
    response.int64_value = request.int64_value
    return response


print({name: int(value) for name, value in ServiceIntrospectionState.__members__.items()})
rclpy.init()
node = rclpy.create_node("introspected")
service = node.create_service(BasicTypes, "serve", serve)
client = node.create_client(BasicTypes, "serve")
events = []
watch = node.create_subscription(BasicTypes.Event, "serve/_service_event", events.append, 10)
print(list(BasicTypes.Event.get_fields_and_field_types().items()))
print(client.wait_for_service(5.0))


def publishers():
    return node.count_publishers("serve/_service_event")


print("before", publishers())
for server_state, client_state, count in (
    (ServiceIntrospectionState.OFF, ServiceIntrospectionState.OFF, 0),
    (ServiceIntrospectionState.METADATA, ServiceIntrospectionState.OFF, 2),
    (ServiceIntrospectionState.OFF, ServiceIntrospectionState.METADATA, 2),
    (ServiceIntrospectionState.CONTENTS, ServiceIntrospectionState.CONTENTS, 4),
):
    attempt(
        "service",
        service.configure_introspection,
        node.get_clock(),
        qos_profile_system_default,
        server_state,
    )
    attempt(
        "client",
        client.configure_introspection,
        node.get_clock(),
        qos_profile_system_default,
        client_state,
    )
    until(lambda count=count: watch.get_publisher_count() == count // 2 or not count)
    print(watch.get_publisher_count())
    events.clear()
    future = client.call_async(BasicTypes.Request(bool_value=True, int64_value=12345))
    rclpy.spin_until_future_complete(node, future, timeout_sec=5.0)
    until(lambda count=count: len(events) >= count, lambda: rclpy.spin_once(node, timeout_sec=0.05))
    for event in sorted(events, key=lambda event: event.info.event_type):
        print(
            KINDS[event.info.event_type],
            event.info.stamp.sec > 0,
            len(event.info.client_gid),
            event.info.sequence_number == events[0].info.sequence_number,
            [(one.bool_value, one.int64_value) for one in event.request],
            [(one.bool_value, one.int64_value) for one in event.response],
        )
rclpy.shutdown()
