"""Publishers of lifecycle nodes: they publish only while the node is active."""

from typing import Any, ClassVar, TypeVar

from bus_ros.rclpy.lifecycle.managed_entity import (
    LifecycleState,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)
from bus_ros.rclpy.logging import get_logger
from bus_ros.rclpy.publisher import Publisher

__all__ = ["LifecyclePublisher", "PublishesWhileActive"]

M = TypeVar("M")


class PublishesWhileActive(SimpleManagedEntity):
    """Base of publishers of lifecycle nodes, in front of the class that publishes."""

    topic_name: Any
    _publisher_class: ClassVar[Any]

    def __init__(self, *args: Any, **keywords: Any) -> None:
        SimpleManagedEntity.__init__(self)
        super(SimpleManagedEntity, self).__init__(*args, **keywords)
        self._has_warned = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._has_warned = False
        return super().on_activate(state)

    def publish(self, msg: Any) -> None:
        """As `Publisher.publish` while the node is active.

        Otherwise it publishes nothing, and warns of the first such message since the node was active.
        """
        if self._enabled:
            self._publisher_class.publish(self, msg)  # with `self`: tests of programs replace `publish`
        elif not self._has_warned:
            self._has_warned = True
            get_logger("LifecyclePublisher").warning(
                f"Trying to publish message on the topic '{self.topic_name}', "
                "but the publisher is not activated"
            )


class LifecyclePublisher(PublishesWhileActive, Publisher[M]):
    """Made by `create_lifecycle_publisher` of a lifecycle node."""

    _publisher_class = Publisher
