"""The services and topics of a node about itself: parameters, their changes, and types.

Owns their start. Must not know the kind of node: `node` only has rclpy's methods.
"""

from contextlib import AbstractContextManager, nullcontext
from typing import Any

from bus.errors import AccessDenied
from bus.parameters.messages import event_message
from bus.parameters.store import Change
from bus_ros.rclpy.parameter import Parameter, parameter_message
from bus_ros.rclpy.qos import qos_profile_parameter_events
from bus_ros.rclpy.type_description_service import TypeDescriptionService

__all__ = ["OwnServices"]


class OwnServices:
    """The services of `node`, from `start` on."""

    def __init__(self, node: Any) -> None:
        self._node = node
        self._parameter_events: Any = None

    def start(self, *, has_parameters: bool, at_once: AbstractContextManager[None] | None = None) -> None:
        """Make the services. Services made in `at_once` may be opened together at its end.

        If access to one is denied, the node works without it, and a warning says so.
        """
        if has_parameters:
            self._start_parameter_services(at_once or nullcontext())
        self._node._type_description_service = TypeDescriptionService(self._node)

    def publish_change(self, change: Change[Parameter]) -> None:
        """Publish a change of parameters on /parameter_events, if the topic has a subscription.

        A subscription that can't be woken yet finds the change when it reads the ring.
        """
        publisher = self._parameter_events
        if publisher is not None and not publisher.is_destroyed and publisher._is_matched():
            event = event_message(parameter_message, self._node.get_fully_qualified_name(), change)
            event.stamp = self._node.get_clock().now().to_msg()
            publisher.publish(event)

    def _start_parameter_services(self, at_once: AbstractContextManager[None]) -> None:
        from bus_ros.rclpy.parameter_service import ParameterService
        from bus_ros.rosidl import message_class

        node = self._node
        try:
            self._parameter_events = node.create_publisher(
                message_class("rcl_interfaces/msg/ParameterEvent"),
                "/parameter_events",
                qos_profile_parameter_events,
            )
        except AccessDenied as denied:
            node.get_logger().warning(f"changes of parameters are told to nobody: {denied}")
        try:
            with at_once:
                ParameterService(node)
        except AccessDenied as denied:
            node.get_logger().warning(f"nobody else can read or set this node's parameters: {denied}")
