"""Base of clients and services that publish their requests and answers on `<service>/_service_event`.

Owns the publisher of that topic. Must not know the transport of requests.
"""

from typing import Any

from bus.errors import PayloadTooLarge
from bus_ros.rclpy.clock import Clock
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.service_introspection import ServiceIntrospectionState

__all__ = ["Introspected", "ServiceEvents"]


class ServiceEvents:
    """The events of one client or one service."""

    def __init__(self, publisher: Any, clock: Clock, has_contents: bool) -> None:
        self.publisher = publisher
        self._clock = clock
        self._has_contents = has_contents

    def publish_event(self, kind: str, client: bytes, number: int, **contents: Any) -> None:
        """Publish an event: REQUEST_SENT with `request`, RESPONSE_RECEIVED with `response`, and so on.

        Without its contents if they are above the limit of messages: they alone may just be below it.
        """
        event = self.publisher.msg_type()
        info = event.info
        info.event_type = getattr(info, kind)
        info.stamp = self._clock.now().to_msg()
        info.client_gid = list(client)
        info.sequence_number = number
        if self._has_contents:
            for name, message in contents.items():
                setattr(event, name, [message])
        try:
            self.publisher.publish(event)
        except PayloadTooLarge:
            for name in contents:
                setattr(event, name, [])
            self.publisher.publish(event)


class Introspected:
    """Base of classes with `node`, `srv_type` and `service_name`."""

    node: Any
    srv_type: Any
    service_name: Any
    events: ServiceEvents | None = None

    def configure_introspection(
        self,
        clock: Clock,
        service_event_qos_profile: QoSProfile,
        introspection_state: ServiceIntrospectionState,
    ) -> None:
        """From now on, publish an event for each request and answer, with the time of `clock`; or stop it.

        Raises TypeError for an invalid state, InvalidHandle if the client or service is destroyed.
        """
        if not isinstance(introspection_state, ServiceIntrospectionState):
            raise TypeError(
                f"introspection_state must be a ServiceIntrospectionState, not {introspection_state!r}"
            )
        self.forget_events()
        if introspection_state is not ServiceIntrospectionState.OFF:
            publisher = self.node.create_publisher(
                self.srv_type.Event, f"{self.service_name}/_service_event", service_event_qos_profile
            )
            has_contents = introspection_state is ServiceIntrospectionState.CONTENTS
            self.events = ServiceEvents(publisher, clock, has_contents)

    def forget_events(self) -> None:
        """Stop publishing events."""
        events, self.events = self.events, None
        if events is not None:
            events.publisher.destroy()
