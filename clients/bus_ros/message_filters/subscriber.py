"""The usual source of a chain of filters: a subscription."""

from typing import Any

from bus_ros.message_filters.simple_filter import SimpleFilter
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile

__all__ = ["Subscriber"]


class Subscriber(SimpleFilter):
    """Puts out the messages of a subscription. Other attributes come from the subscription, `sub`.

    `kwargs`: keywords for `Node.create_subscription`; its documentation lists the errors.
    """

    def __init__(
        self, node: Node, msg_type: type, topic: str, qos_profile: QoSProfile | int = 10, **kwargs: Any
    ) -> None:
        super().__init__()
        self.node = node
        self.topic = topic
        self.sub: Any = node.create_subscription(msg_type, topic, self.callback, qos_profile, **kwargs)

    def callback(self, msg: Any) -> None:
        self.signalMessage(msg)

    def getTopic(self) -> str:
        """The topic as given, before remapping."""
        return self.topic

    def __getattr__(self, key: str) -> Any:
        if key == "sub":  # not set yet
            raise AttributeError(key)
        return getattr(self.sub, key)
