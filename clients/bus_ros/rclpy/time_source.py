"""Feeds simulated time from `/clock` to a node's clocks, while its parameter `use_sim_time` is true.

Must not know the storage of parameters or the transport of messages: both go through the node.
"""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from bus_ros.rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from bus_ros.rclpy.clock import BaseClock, OverridableClock
from bus_ros.rclpy.impl.rcutils_logger import RcutilsLogger
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.qos import QoSProfile, ReliabilityPolicy
from bus_ros.rclpy.subscription import BaseSubscription
from bus_ros.rclpy.time import Time

__all__ = ["CLOCK_TOPIC", "USE_SIM_TIME_NAME", "TimeSource"]

CLOCK_TOPIC = "/clock"
USE_SIM_TIME_NAME = "use_sim_time"


@runtime_checkable
class _Node(Protocol):
    """The interface of a node for its time source."""

    def get_logger(self) -> RcutilsLogger: ...
    def has_parameter(self, name: str) -> bool: ...
    def declare_parameter(self, name: str, value: Any = None) -> Parameter: ...
    def get_parameter(self, name: str) -> Parameter: ...
    def add_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None: ...
    def remove_post_set_parameters_callback(self, callback: Callable[[list[Parameter]], None]) -> None: ...
    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile,
        *,
        callback_group: CallbackGroup | None = None,
    ) -> Any: ...
    def destroy_subscription(self, subscription: Any) -> bool: ...


class TimeSource:
    """The time source of one node, for all attached clocks."""

    def __init__(self, *, node: _Node | None = None) -> None:
        self._node: _Node | None = None
        self._clock_sub: BaseSubscription[Any] | None = None
        # A separate group: a sleeping callback in the node's default group must not stop its clock.
        self._group = MutuallyExclusiveCallbackGroup()
        self._clocks: list[OverridableClock] = []
        self._last: Time | None = None
        self._is_active = False
        if node is not None:
            self.attach_node(node)

    @property
    def ros_time_is_active(self) -> bool:
        """Whether the clocks show the simulation's time."""
        return self._is_active

    @ros_time_is_active.setter
    def ros_time_is_active(self, enabled: bool) -> None:
        if enabled == self._is_active:
            return
        self._is_active = enabled
        for clock in self._clocks:
            clock._set_ros_time_is_active(enabled)
        if enabled:
            self._subscribe()
        else:
            self._unsubscribe()

    def _get_node(self) -> _Node | None:
        """The attached node, by rclpy's private name."""
        return self._node

    def attach_node(self, node: _Node) -> None:
        """Follow this node's `use_sim_time`, and declare it if it is undeclared; raises TypeError."""
        if not isinstance(node, _Node):
            raise TypeError("Node must be of type rclpy.node.Node")
        if self._node is not None:
            self.detach_node()
        self._node = node
        if not node.has_parameter(USE_SIM_TIME_NAME):
            node.declare_parameter(USE_SIM_TIME_NAME, False)
        self._follow(node.get_parameter(USE_SIM_TIME_NAME).value)
        node.add_post_set_parameters_callback(self._on_parameters)
        if self._is_active:
            self._subscribe()

    def detach_node(self) -> None:
        """Stop following the node; the clocks keep their last time."""
        self._unsubscribe()
        if self._node is not None:
            self._node.remove_post_set_parameters_callback(self._on_parameters)
            self._node = None

    def attach_clock(self, clock: BaseClock) -> None:
        """Attach a clock. Raises TypeError for another object, ValueError if its type is not ROS_TIME."""
        if not isinstance(clock, BaseClock):
            raise TypeError("Clock must be of type rclpy.clock.Clock")
        if not isinstance(clock, OverridableClock):
            raise ValueError("Only clocks with type ROS_TIME can be attached.")
        if self._last is not None:
            clock.set_ros_time_override(self._last)
        clock._set_ros_time_is_active(self._is_active)
        self._clocks.append(clock)

    def detach_clock(self, clock: BaseClock) -> None:
        """Detach a clock; does nothing if it is not attached."""
        if isinstance(clock, OverridableClock) and clock in self._clocks:
            self._clocks.remove(clock)

    def clock_callback(self, msg: Any) -> None:
        """Handle a rosgraph_msgs.msg.Clock."""
        try:
            self._last = Time.from_msg(msg.clock)
        except ValueError as error:  # a publisher's mistake must not end this program
            if self._node is not None:
                text = f"'{CLOCK_TOPIC}' has no time: {error}"
                self._node.get_logger().error(text, throttle_duration_sec=1.0)
            return
        for clock in self._clocks:
            clock.set_ros_time_override(self._last)

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            if parameter.name == USE_SIM_TIME_NAME:
                self._follow(parameter.value)

    def _follow(self, value: object) -> None:
        if isinstance(value, bool):
            self.ros_time_is_active = value
        elif self._node is not None:
            self._node.get_logger().error(
                f"Invalid type for parameter '{USE_SIM_TIME_NAME}' {type(value).__name__} should be bool"
            )

    def _subscribe(self) -> None:
        if self._node is None or self._clock_sub is not None:
            return
        from bus_ros.rosidl import message_class  # late: for simulations only

        self._clock_sub = self._node.create_subscription(
            message_class("rosgraph_msgs/msg/Clock"),
            CLOCK_TOPIC,
            self.clock_callback,
            QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
            callback_group=self._group,
        )

    def _unsubscribe(self) -> None:
        subscription, self._clock_sub = self._clock_sub, None
        if subscription is not None and self._node is not None:
            self._node.destroy_subscription(subscription)
