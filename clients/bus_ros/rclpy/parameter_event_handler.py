"""`rclpy.parameter_event_handler`: callbacks for changed parameters of any node, from `/parameter_events`.

Owns the callbacks and their selection by event. Must not know the storage of parameters.
"""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from bus_ros.rclpy.parameter import parameter_message
from bus_ros.rclpy.qos import QoSProfile, qos_profile_parameter_events

if TYPE_CHECKING:
    from bus_ros.rclpy.callback_groups import CallbackGroup
    from bus_ros.rclpy.event_handler import SubscriptionEventCallbacks
    from bus_ros.rclpy.node import Node
    from bus_ros.rclpy.qos_overriding_options import QoSOverridingOptions

__all__ = ["ParameterCallbackHandle", "ParameterEventCallbackHandle", "ParameterEventHandler"]

_GONE = "Callback doesn't exist"


class ParameterCallbackHandle:
    """A callback for one parameter of one node; used to remove it."""

    def __init__(self, parameter_name: str, node_name: str, callback: Callable[[Any], object]) -> None:
        self.parameter_name = parameter_name
        self.node_name = node_name
        self.callback = callback


class ParameterEventCallbackHandle:
    """A callback for each event; used to remove it."""

    def __init__(self, callback: Callable[[Any], object]) -> None:
        self.callback = callback


class _Callbacks:
    """The callbacks of one ParameterEventHandler, the newest first."""

    def __init__(self) -> None:
        self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = {}
        """By the names of the parameter and the node."""
        self.event_callbacks: list[ParameterEventCallbackHandle] = []

    def event_callback(self, event: Any) -> None:
        """Call back for an event."""
        for (parameter_name, node_name), callbacks in tuple(self.parameter_callbacks.items()):
            parameter = ParameterEventHandler.get_parameter_from_event(event, parameter_name, node_name)
            if parameter is not None:
                for one in tuple(callbacks):
                    one.callback(parameter)
        for every in tuple(self.event_callbacks):
            every.callback(event)

    def add(self, handle: ParameterCallbackHandle) -> None:
        self.parameter_callbacks.setdefault((handle.parameter_name, handle.node_name), []).insert(0, handle)

    def remove(self, handle: ParameterCallbackHandle) -> None:
        """Raises RuntimeError if it is removed already."""
        key = handle.parameter_name, handle.node_name
        callbacks = self.parameter_callbacks.get(key, [])
        if handle not in callbacks:
            raise RuntimeError(_GONE)
        callbacks.remove(handle)
        if not callbacks:
            del self.parameter_callbacks[key]


class ParameterEventHandler:
    """Receives changes of parameters, and calls back in the executor of `node`.

    The newest of several callbacks is called first, callbacks for one parameter before callbacks for events.
    Values are messages: rcl_interfaces/msg/Parameter and ParameterEvent.
    """

    Callbacks = _Callbacks

    def __init__(
        self,
        node: "Node",
        qos_profile: QoSProfile = qos_profile_parameter_events,
        callback_group: "CallbackGroup | None" = None,
        event_callbacks: "SubscriptionEventCallbacks | None" = None,
        qos_overriding_options: "QoSOverridingOptions | None" = None,
        raw: bool = False,
    ) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = self.Callbacks()
        self.parameter_event_subscription = node.create_subscription(
            parameter_message("ParameterEvent"),
            "/parameter_events",
            self._callbacks.event_callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def destroy(self) -> None:
        """Stop receiving events."""
        self.node.destroy_subscription(self.parameter_event_subscription)

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """The new or changed parameter of that name and node; None if it is not in the event."""
        if event.node == node_name:
            for parameter in (*event.new_parameters, *event.changed_parameters):
                if parameter.name == parameter_name:
                    return parameter
        return None

    @staticmethod
    def get_parameters_from_event(event: Any) -> Iterable[Any]:
        """The new and the changed parameters."""
        yield from event.new_parameters
        yield from event.changed_parameters

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], object]
    ) -> ParameterCallbackHandle:
        """Call `callback(parameter)` when this parameter of that node is new or changed.

        A node name without a leading slash is relative to the namespace of this node.
        """
        handle = ParameterCallbackHandle(parameter_name, self._resolve_path(node_name), callback)
        self._callbacks.add(handle)
        return handle

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError if it is removed already."""
        self._callbacks.remove(handle)

    def add_parameter_event_callback(self, callback: Callable[[Any], object]) -> ParameterEventCallbackHandle:
        """Call `callback(event)` for each event."""
        handle = ParameterEventCallbackHandle(callback)
        self._callbacks.event_callbacks.insert(0, handle)
        return handle

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Remove a callback. Raises RuntimeError if it is removed already."""
        if handle not in self._callbacks.event_callbacks:
            raise RuntimeError(_GONE)
        self._callbacks.event_callbacks.remove(handle)

    def _resolve_path(self, node_name: str | None = None) -> str:
        if not node_name:
            return self.node.get_fully_qualified_name()
        if node_name.startswith("/"):
            return node_name
        return f"{self.node.get_namespace().rstrip('/')}/{node_name}"
